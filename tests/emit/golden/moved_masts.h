#ifndef MOVED_MASTS__H
#define MOVED_MASTS__H

/*
 * moved-masts: Ranges to masts that stand uncertainly: errors that rows share.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum moved_masts_status {
    MOVED_MASTS_CONVERGED = 0,
    MOVED_MASTS_NOT_CONVERGED = 1,
    MOVED_MASTS_UNOBSERVABLE = 2,
    MOVED_MASTS_INFEASIBLE = 3,
    MOVED_MASTS_NO_AGREEMENT = 4,
    MOVED_MASTS_NOT_FINITE = 5,
    MOVED_MASTS_NO_ROWS = 6,
    MOVED_MASTS_UNKNOWN_KEY = 7,
    MOVED_MASTS_UNKNOWN_CASE = 8,
    MOVED_MASTS_BAD_NOISE = 9,
    MOVED_MASTS_BAD_BOUNDS = 10,
    MOVED_MASTS_BAD_START = 11,
    MOVED_MASTS_NO_START = 12,
    MOVED_MASTS_NOT_CONNECTED = 13,
    MOVED_MASTS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long masts_rows;    /* rows of `masts` */
    const char *const *masts_id;    /* `id` */
    const double *masts_x;    /* `x` */
    const double *masts_y;    /* `y` */
    const double *masts_s;    /* `s` */
    long ranges_rows;    /* rows of `ranges` */
    const char *const *ranges_mast;    /* `mast` */
    const double *ranges_r;    /* `r` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
    const double *start_masts_x;    /* where masts.x begins: a number for each member; NULL: as the README says */
} moved_masts_data;

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
    long masts_x_members;
    const long *masts_x_rows;    /* (members) the row of the table that names each */
    const double *masts_x;          /* (members × 1) real: true values of the column x, which is measured with errors */
    const double *masts_x_sigma;    /* (members × 1) */
} moved_masts_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} moved_masts_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void moved_masts_workspace_size(const moved_masts_data *data, moved_masts_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int moved_masts_solve(const moved_masts_data *data, moved_masts_result *result, moved_masts_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int moved_masts_begin(const moved_masts_data *data, moved_masts_result *result, moved_masts_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long moved_masts_residual_count(const moved_masts_data *data, moved_masts_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void moved_masts_residuals(const moved_masts_data *data, const double *point, double *residuals,
    moved_masts_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void moved_masts_jacobian(const moved_masts_data *data, const double *point, double *jacobian,
    moved_masts_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int moved_masts_covariance(const moved_masts_data *data, const double *point, double *covariance,
    moved_masts_workspace *workspace);

/* What a status means. */
const char *moved_masts_status_text(int status);

#endif
