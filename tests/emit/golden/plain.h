#ifndef PLAIN__H
#define PLAIN__H

/*
 * plain: A straight line.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum plain_status {
    PLAIN_CONVERGED = 0,
    PLAIN_NOT_CONVERGED = 1,
    PLAIN_UNOBSERVABLE = 2,
    PLAIN_INFEASIBLE = 3,
    PLAIN_NO_AGREEMENT = 4,
    PLAIN_NOT_FINITE = 5,
    PLAIN_NO_ROWS = 6,
    PLAIN_UNKNOWN_KEY = 7,
    PLAIN_UNKNOWN_CASE = 8,
    PLAIN_BAD_NOISE = 9,
    PLAIN_BAD_BOUNDS = 10,
    PLAIN_BAD_START = 11,
    PLAIN_NO_START = 12,
    PLAIN_NOT_CONNECTED = 13,
    PLAIN_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
} plain_data;

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
    const double *a;          /* (1) real: slope */
    const double *a_sigma;    /* (1) */
    const double *b;          /* (1) real */
    const double *b_sigma;    /* (1) */
} plain_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} plain_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void plain_workspace_size(const plain_data *data, plain_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int plain_solve(const plain_data *data, plain_result *result, plain_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int plain_begin(const plain_data *data, plain_result *result, plain_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long plain_residual_count(const plain_data *data, plain_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void plain_residuals(const plain_data *data, const double *point, double *residuals,
    plain_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void plain_jacobian(const plain_data *data, const double *point, double *jacobian,
    plain_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int plain_covariance(const plain_data *data, const double *point, double *covariance,
    plain_workspace *workspace);

/* What a status means. */
const char *plain_status_text(int status);

#endif
