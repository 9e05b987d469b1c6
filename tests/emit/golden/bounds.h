#ifndef BOUNDS__H
#define BOUNDS__H

/*
 * bounds: A prior, and a bound that holds.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum bounds_status {
    BOUNDS_CONVERGED = 0,
    BOUNDS_NOT_CONVERGED = 1,
    BOUNDS_UNOBSERVABLE = 2,
    BOUNDS_INFEASIBLE = 3,
    BOUNDS_NO_AGREEMENT = 4,
    BOUNDS_NOT_FINITE = 5,
    BOUNDS_NO_ROWS = 6,
    BOUNDS_UNKNOWN_KEY = 7,
    BOUNDS_UNKNOWN_CASE = 8,
    BOUNDS_BAD_NOISE = 9,
    BOUNDS_BAD_BOUNDS = 10,
    BOUNDS_BAD_START = 11,
    BOUNDS_NO_START = 12,
    BOUNDS_NOT_CONNECTED = 13,
    BOUNDS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
} bounds_data;

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
    const double *a;          /* (1) real */
    const double *a_sigma;    /* (1) */
    const double *b;          /* (1) positive */
    const double *b_sigma;    /* (1) */
} bounds_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} bounds_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void bounds_workspace_size(const bounds_data *data, bounds_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int bounds_solve(const bounds_data *data, bounds_result *result, bounds_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int bounds_begin(const bounds_data *data, bounds_result *result, bounds_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long bounds_residual_count(const bounds_data *data, bounds_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void bounds_residuals(const bounds_data *data, const double *point, double *residuals,
    bounds_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void bounds_jacobian(const bounds_data *data, const double *point, double *jacobian,
    bounds_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int bounds_covariance(const bounds_data *data, const double *point, double *covariance,
    bounds_workspace *workspace);

/* What a status means. */
const char *bounds_status_text(int status);

#endif
