#ifndef SIGHTS__H
#define SIGHTS__H

/*
 * sights: Where a camera stands, from points; one was mistaken for another.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum sights_status {
    SIGHTS_CONVERGED = 0,
    SIGHTS_NOT_CONVERGED = 1,
    SIGHTS_UNOBSERVABLE = 2,
    SIGHTS_INFEASIBLE = 3,
    SIGHTS_NO_AGREEMENT = 4,
    SIGHTS_NOT_FINITE = 5,
    SIGHTS_NO_ROWS = 6,
    SIGHTS_UNKNOWN_KEY = 7,
    SIGHTS_UNKNOWN_CASE = 8,
    SIGHTS_BAD_NOISE = 9,
    SIGHTS_BAD_BOUNDS = 10,
    SIGHTS_BAD_START = 11,
    SIGHTS_NO_START = 12,
    SIGHTS_NOT_CONNECTED = 13,
    SIGHTS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *d_z;    /* `z` */
    const double *d_u;    /* `u` */
    const double *d_v;    /* `v` */
    const double *start_T;    /* where T begins: 7 numbers; NULL: as the README says */
} sights_data;

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
    const double *T;          /* (7) pose */
    const double *T_sigma;    /* (6) */
} sights_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} sights_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void sights_workspace_size(const sights_data *data, sights_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int sights_solve(const sights_data *data, sights_result *result, sights_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int sights_begin(const sights_data *data, sights_result *result, sights_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long sights_residual_count(const sights_data *data, sights_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void sights_residuals(const sights_data *data, const double *point, double *residuals,
    sights_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void sights_jacobian(const sights_data *data, const double *point, double *jacobian,
    sights_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int sights_covariance(const sights_data *data, const double *point, double *covariance,
    sights_workspace *workspace);

/* What a status means. */
const char *sights_status_text(int status);

#endif
