#ifndef WEIGHTS__H
#define WEIGHTS__H

/*
 * weights: A point, measured in both coordinates together.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum weights_status {
    WEIGHTS_CONVERGED = 0,
    WEIGHTS_NOT_CONVERGED = 1,
    WEIGHTS_UNOBSERVABLE = 2,
    WEIGHTS_INFEASIBLE = 3,
    WEIGHTS_NO_AGREEMENT = 4,
    WEIGHTS_NOT_FINITE = 5,
    WEIGHTS_NO_ROWS = 6,
    WEIGHTS_UNKNOWN_KEY = 7,
    WEIGHTS_UNKNOWN_CASE = 8,
    WEIGHTS_BAD_NOISE = 9,
    WEIGHTS_BAD_BOUNDS = 10,
    WEIGHTS_BAD_START = 11,
    WEIGHTS_NO_START = 12,
    WEIGHTS_NOT_CONNECTED = 13,
    WEIGHTS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_u;    /* `u` */
    const double *d_v;    /* `v` */
    const double *d_s;    /* `s` */
    const double *d_c;    /* `c` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
} weights_data;

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
} weights_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} weights_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void weights_workspace_size(const weights_data *data, weights_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int weights_solve(const weights_data *data, weights_result *result, weights_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int weights_begin(const weights_data *data, weights_result *result, weights_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long weights_residual_count(const weights_data *data, weights_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void weights_residuals(const weights_data *data, const double *point, double *residuals,
    weights_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void weights_jacobian(const weights_data *data, const double *point, double *jacobian,
    weights_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int weights_covariance(const weights_data *data, const double *point, double *covariance,
    weights_workspace *workspace);

/* What a status means. */
const char *weights_status_text(int status);

#endif
