#ifndef LOSS__H
#define LOSS__H

/*
 * loss: A straight line with an outlier.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum loss_status {
    LOSS_CONVERGED = 0,
    LOSS_NOT_CONVERGED = 1,
    LOSS_UNOBSERVABLE = 2,
    LOSS_INFEASIBLE = 3,
    LOSS_NO_AGREEMENT = 4,
    LOSS_NOT_FINITE = 5,
    LOSS_NO_ROWS = 6,
    LOSS_UNKNOWN_KEY = 7,
    LOSS_UNKNOWN_CASE = 8,
    LOSS_BAD_NOISE = 9,
    LOSS_BAD_BOUNDS = 10,
    LOSS_BAD_START = 11,
    LOSS_NO_START = 12,
    LOSS_NOT_CONNECTED = 13,
    LOSS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
} loss_data;

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
    const double *b;          /* (1) real */
    const double *b_sigma;    /* (1) */
} loss_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} loss_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void loss_workspace_size(const loss_data *data, loss_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int loss_solve(const loss_data *data, loss_result *result, loss_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int loss_begin(const loss_data *data, loss_result *result, loss_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long loss_residual_count(const loss_data *data, loss_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void loss_residuals(const loss_data *data, const double *point, double *residuals,
    loss_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void loss_jacobian(const loss_data *data, const double *point, double *jacobian,
    loss_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int loss_covariance(const loss_data *data, const double *point, double *covariance,
    loss_workspace *workspace);

/* What a status means. */
const char *loss_status_text(int status);

#endif
