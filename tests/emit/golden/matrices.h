#ifndef MATRICES__H
#define MATRICES__H

/*
 * matrices: A point that moves, each place with a covariance matrix; one is wrong.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum matrices_status {
    MATRICES_CONVERGED = 0,
    MATRICES_NOT_CONVERGED = 1,
    MATRICES_UNOBSERVABLE = 2,
    MATRICES_INFEASIBLE = 3,
    MATRICES_NO_AGREEMENT = 4,
    MATRICES_NOT_FINITE = 5,
    MATRICES_NO_ROWS = 6,
    MATRICES_UNKNOWN_KEY = 7,
    MATRICES_UNKNOWN_CASE = 8,
    MATRICES_BAD_NOISE = 9,
    MATRICES_BAD_BOUNDS = 10,
    MATRICES_BAD_START = 11,
    MATRICES_NO_START = 12,
    MATRICES_NOT_CONNECTED = 13,
    MATRICES_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_t;    /* `t` */
    const double *d_u;    /* `u` */
    const double *d_v;    /* `v` */
    const double *d_s;    /* `s` */
    const double *d_c;    /* `c` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
    const double *start_w;    /* where w begins: 2 numbers; NULL: as the README says */
} matrices_data;

/* What is answered, in SI; `sigma` are standard deviations. */
typedef struct {
    int status;
    long iterations, evaluations;
    double cost;           /* weighted sum of squares, without losses */
    double robust_cost;    /* the same with losses */
    long freedom;          /* degrees of freedom */
    double sigma0;         /* sqrt(cost / freedom); 0 without freedom */
    long numbers;          /* N, numbers of all unknowns */
    const double *point;   /* (N) the estimates, unknown after unknown, member after member */
    long free;             /* n, estimated coordinates */
    const long *coordinates;     /* (n) their places among all coordinates */
    const double *covariance;    /* (n, n) row by row; NaN: not determined */
    const double *sigmas;        /* of all coordinates; 0: it stays, negative: not determined */
    long units, inliers;   /* equations of rows that were looked at, and those that agree */
    int ambiguous;         /* 1: another solution explains the data as well */
    const long *inside;    /* (units) 1: it agrees; clause by clause, row by row, then by equation */
    const double *p;          /* (2) vector */
    const double *p_sigma;    /* (2) */
    const double *w;          /* (2) vector */
    const double *w_sigma;    /* (2) */
} matrices_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} matrices_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void matrices_workspace_size(const matrices_data *data, matrices_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int matrices_solve(const matrices_data *data, matrices_result *result, matrices_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int matrices_begin(const matrices_data *data, matrices_result *result, matrices_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long matrices_residual_count(const matrices_data *data, matrices_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void matrices_residuals(const matrices_data *data, const double *point, double *residuals,
    matrices_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void matrices_jacobian(const matrices_data *data, const double *point, double *jacobian,
    matrices_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int matrices_covariance(const matrices_data *data, const double *point, double *covariance,
    matrices_workspace *workspace);

/* What a status means. */
const char *matrices_status_text(int status);

#endif
