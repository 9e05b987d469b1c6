#ifndef FOR_EACH__H
#define FOR_EACH__H

/*
 * for-each: One mean for each day.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum for_each_status {
    FOR_EACH_CONVERGED = 0,
    FOR_EACH_NOT_CONVERGED = 1,
    FOR_EACH_UNOBSERVABLE = 2,
    FOR_EACH_INFEASIBLE = 3,
    FOR_EACH_NO_AGREEMENT = 4,
    FOR_EACH_NOT_FINITE = 5,
    FOR_EACH_NO_ROWS = 6,
    FOR_EACH_UNKNOWN_KEY = 7,
    FOR_EACH_UNKNOWN_CASE = 8,
    FOR_EACH_BAD_NOISE = 9,
    FOR_EACH_BAD_BOUNDS = 10,
    FOR_EACH_BAD_START = 11,
    FOR_EACH_NO_START = 12,
    FOR_EACH_NOT_CONNECTED = 13,
    FOR_EACH_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_day;    /* `day` */
    const double *d_y;    /* `y` */
    const double *start_m;    /* where m begins: a number; NULL: as the README says */
} for_each_data;

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
    const double *m;          /* (1) real */
    const double *m_sigma;    /* (1) */
} for_each_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} for_each_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void for_each_workspace_size(const for_each_data *data, for_each_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int for_each_solve(const for_each_data *data, for_each_result *result, for_each_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int for_each_begin(const for_each_data *data, for_each_result *result, for_each_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long for_each_residual_count(const for_each_data *data, for_each_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void for_each_residuals(const for_each_data *data, const double *point, double *residuals,
    for_each_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void for_each_jacobian(const for_each_data *data, const double *point, double *jacobian,
    for_each_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int for_each_covariance(const for_each_data *data, const double *point, double *covariance,
    for_each_workspace *workspace);

/* What a status means. */
const char *for_each_status_text(int status);

#endif
