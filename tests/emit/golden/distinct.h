#ifndef DISTINCT__H
#define DISTINCT__H

/*
 * distinct: One offset for each value of a column; some rows are left out.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum distinct_status {
    DISTINCT_CONVERGED = 0,
    DISTINCT_NOT_CONVERGED = 1,
    DISTINCT_UNOBSERVABLE = 2,
    DISTINCT_INFEASIBLE = 3,
    DISTINCT_NO_AGREEMENT = 4,
    DISTINCT_NOT_FINITE = 5,
    DISTINCT_NO_ROWS = 6,
    DISTINCT_UNKNOWN_KEY = 7,
    DISTINCT_UNKNOWN_CASE = 8,
    DISTINCT_BAD_NOISE = 9,
    DISTINCT_BAD_BOUNDS = 10,
    DISTINCT_BAD_START = 11,
    DISTINCT_NO_START = 12,
    DISTINCT_NOT_CONNECTED = 13,
    DISTINCT_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const char *const *d_kind;    /* `kind` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *d_good;    /* `good` */
    const double *start_k;    /* where k begins: a number; NULL: as the README says */
    const double *start_o;    /* where o begins: a number for each member; NULL: as the README says */
} distinct_data;

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
    const double *k;          /* (1) real */
    const double *k_sigma;    /* (1) */
    long o_members;
    const long *o_rows;    /* (members) the row of the table that names each */
    const double *o;          /* (members × 1) real */
    const double *o_sigma;    /* (members × 1) */
} distinct_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} distinct_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void distinct_workspace_size(const distinct_data *data, distinct_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int distinct_solve(const distinct_data *data, distinct_result *result, distinct_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int distinct_begin(const distinct_data *data, distinct_result *result, distinct_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long distinct_residual_count(const distinct_data *data, distinct_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void distinct_residuals(const distinct_data *data, const double *point, double *residuals,
    distinct_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void distinct_jacobian(const distinct_data *data, const double *point, double *jacobian,
    distinct_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int distinct_covariance(const distinct_data *data, const double *point, double *covariance,
    distinct_workspace *workspace);

/* What a status means. */
const char *distinct_status_text(int status);

#endif
