#ifndef INFORMATION__H
#define INFORMATION__H

/*
 * information
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum information_status {
    INFORMATION_CONVERGED = 0,
    INFORMATION_NOT_CONVERGED = 1,
    INFORMATION_UNOBSERVABLE = 2,
    INFORMATION_INFEASIBLE = 3,
    INFORMATION_NO_AGREEMENT = 4,
    INFORMATION_NOT_FINITE = 5,
    INFORMATION_NO_ROWS = 6,
    INFORMATION_UNKNOWN_KEY = 7,
    INFORMATION_UNKNOWN_CASE = 8,
    INFORMATION_BAD_NOISE = 9,
    INFORMATION_BAD_BOUNDS = 10,
    INFORMATION_BAD_START = 11,
    INFORMATION_NO_START = 12,
    INFORMATION_NOT_CONNECTED = 13,
    INFORMATION_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_u;    /* `u` */
    const double *d_v;    /* `v` */
    const double *d_s;    /* `s` */
    const double *d_c;    /* `c` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
} information_data;

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
    const double *p;          /* (2) vector */
    const double *p_sigma;    /* (2) */
} information_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} information_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void information_workspace_size(const information_data *data, information_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int information_solve(const information_data *data, information_result *result, information_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int information_begin(const information_data *data, information_result *result, information_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long information_residual_count(const information_data *data, information_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void information_residuals(const information_data *data, const double *point, double *residuals,
    information_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void information_jacobian(const information_data *data, const double *point, double *jacobian,
    information_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int information_covariance(const information_data *data, const double *point, double *covariance,
    information_workspace *workspace);

/* What a status means. */
const char *information_status_text(int status);

#endif
