#ifndef LIMITED__H
#define LIMITED__H

/*
 * limited: A parabola with a prior, and a stated limit.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum limited_status {
    LIMITED_CONVERGED = 0,
    LIMITED_NOT_CONVERGED = 1,
    LIMITED_UNOBSERVABLE = 2,
    LIMITED_INFEASIBLE = 3,
    LIMITED_NO_AGREEMENT = 4,
    LIMITED_NOT_FINITE = 5,
    LIMITED_NO_ROWS = 6,
    LIMITED_UNKNOWN_KEY = 7,
    LIMITED_UNKNOWN_CASE = 8,
    LIMITED_BAD_NOISE = 9,
    LIMITED_BAD_BOUNDS = 10,
    LIMITED_BAD_START = 11,
    LIMITED_NO_START = 12,
    LIMITED_NOT_CONNECTED = 13,
    LIMITED_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
    const double *start_q;    /* where q begins: a number; NULL: as the README says */
} limited_data;

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
    const double *a;          /* (1) real */
    const double *a_sigma;    /* (1) */
    const double *b;          /* (1) real */
    const double *b_sigma;    /* (1) */
    const double *q;          /* (1) real */
    const double *q_sigma;    /* (1) */
} limited_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} limited_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void limited_workspace_size(const limited_data *data, limited_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int limited_solve(const limited_data *data, limited_result *result, limited_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int limited_begin(const limited_data *data, limited_result *result, limited_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long limited_residual_count(const limited_data *data, limited_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void limited_residuals(const limited_data *data, const double *point, double *residuals,
    limited_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void limited_jacobian(const limited_data *data, const double *point, double *jacobian,
    limited_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int limited_covariance(const limited_data *data, const double *point, double *covariance,
    limited_workspace *workspace);

/* What a status means. */
const char *limited_status_text(int status);

#endif
