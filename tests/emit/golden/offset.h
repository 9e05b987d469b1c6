#ifndef OFFSET__H
#define OFFSET__H

/*
 * offset: A place and an offset, with unknown noise.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum offset_status {
    OFFSET_CONVERGED = 0,
    OFFSET_NOT_CONVERGED = 1,
    OFFSET_UNOBSERVABLE = 2,
    OFFSET_INFEASIBLE = 3,
    OFFSET_NO_AGREEMENT = 4,
    OFFSET_NOT_FINITE = 5,
    OFFSET_NO_ROWS = 6,
    OFFSET_UNKNOWN_KEY = 7,
    OFFSET_UNKNOWN_CASE = 8,
    OFFSET_BAD_NOISE = 9,
    OFFSET_BAD_BOUNDS = 10,
    OFFSET_BAD_START = 11,
    OFFSET_NO_START = 12,
    OFFSET_NOT_CONNECTED = 13,
    OFFSET_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long masts_rows;    /* rows of `masts` */
    const char *const *masts_id;    /* `id` */
    const double *masts_x;    /* `x` */
    const double *masts_y;    /* `y` */
    long ranges_rows;    /* rows of `ranges` */
    const char *const *ranges_mast;    /* `mast` */
    const double *ranges_r;    /* `r` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
    const double *start_o;    /* where o begins: a number; NULL: as the README says */
} offset_data;

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
    const double *p;          /* (2) vector */
    const double *p_sigma;    /* (2) */
    const double *o;          /* (1) real */
    const double *o_sigma;    /* (1) */
} offset_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} offset_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void offset_workspace_size(const offset_data *data, offset_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int offset_solve(const offset_data *data, offset_result *result, offset_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int offset_begin(const offset_data *data, offset_result *result, offset_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long offset_residual_count(const offset_data *data, offset_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void offset_residuals(const offset_data *data, const double *point, double *residuals,
    offset_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void offset_jacobian(const offset_data *data, const double *point, double *jacobian,
    offset_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int offset_covariance(const offset_data *data, const double *point, double *covariance,
    offset_workspace *workspace);

/* What a status means. */
const char *offset_status_text(int status);

#endif
