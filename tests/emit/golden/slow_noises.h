#ifndef SLOW_NOISES__H
#define SLOW_NOISES__H

/*
 * slow-noises: Two groups of unknown noise whose factors settle over many rounds.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum slow_noises_status {
    SLOW_NOISES_CONVERGED = 0,
    SLOW_NOISES_NOT_CONVERGED = 1,
    SLOW_NOISES_UNOBSERVABLE = 2,
    SLOW_NOISES_INFEASIBLE = 3,
    SLOW_NOISES_NO_AGREEMENT = 4,
    SLOW_NOISES_NOT_FINITE = 5,
    SLOW_NOISES_NO_ROWS = 6,
    SLOW_NOISES_UNKNOWN_KEY = 7,
    SLOW_NOISES_UNKNOWN_CASE = 8,
    SLOW_NOISES_BAD_NOISE = 9,
    SLOW_NOISES_BAD_BOUNDS = 10,
    SLOW_NOISES_BAD_START = 11,
    SLOW_NOISES_NO_START = 12,
    SLOW_NOISES_NOT_CONNECTED = 13,
    SLOW_NOISES_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    long e_rows;    /* rows of `e` */
    const double *e_x;    /* `x` */
    const double *e_y;    /* `y` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
} slow_noises_data;

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
} slow_noises_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} slow_noises_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void slow_noises_workspace_size(const slow_noises_data *data, slow_noises_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int slow_noises_solve(const slow_noises_data *data, slow_noises_result *result, slow_noises_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int slow_noises_begin(const slow_noises_data *data, slow_noises_result *result, slow_noises_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long slow_noises_residual_count(const slow_noises_data *data, slow_noises_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void slow_noises_residuals(const slow_noises_data *data, const double *point, double *residuals,
    slow_noises_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void slow_noises_jacobian(const slow_noises_data *data, const double *point, double *jacobian,
    slow_noises_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int slow_noises_covariance(const slow_noises_data *data, const double *point, double *covariance,
    slow_noises_workspace *workspace);

/* What a status means. */
const char *slow_noises_status_text(int status);

#endif
