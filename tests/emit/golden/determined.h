#ifndef DETERMINED__H
#define DETERMINED__H

/*
 * determined: Two constraints leave one unknown no freedom: its variance is zero.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum determined_status {
    DETERMINED_CONVERGED = 0,
    DETERMINED_NOT_CONVERGED = 1,
    DETERMINED_UNOBSERVABLE = 2,
    DETERMINED_INFEASIBLE = 3,
    DETERMINED_NO_AGREEMENT = 4,
    DETERMINED_NOT_FINITE = 5,
    DETERMINED_NO_ROWS = 6,
    DETERMINED_UNKNOWN_KEY = 7,
    DETERMINED_UNKNOWN_CASE = 8,
    DETERMINED_BAD_NOISE = 9,
    DETERMINED_BAD_BOUNDS = 10,
    DETERMINED_BAD_START = 11,
    DETERMINED_NO_START = 12,
    DETERMINED_NOT_CONNECTED = 13,
    DETERMINED_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *d_z;    /* `z` */
    const double *start_p;    /* where p begins: 3 numbers; NULL: as the README says */
} determined_data;

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
    const double *p;          /* (3) vector */
    const double *p_sigma;    /* (3) */
} determined_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} determined_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void determined_workspace_size(const determined_data *data, determined_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int determined_solve(const determined_data *data, determined_result *result, determined_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int determined_begin(const determined_data *data, determined_result *result, determined_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long determined_residual_count(const determined_data *data, determined_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void determined_residuals(const determined_data *data, const double *point, double *residuals,
    determined_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void determined_jacobian(const determined_data *data, const double *point, double *jacobian,
    determined_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int determined_covariance(const determined_data *data, const double *point, double *covariance,
    determined_workspace *workspace);

/* What a status means. */
const char *determined_status_text(int status);

#endif
