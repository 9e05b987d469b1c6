#ifndef UNSTARTED__H
#define UNSTARTED__H

/*
 * unstarted: Places from good ranges, epoch by epoch: consensus gives the starts alone.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum unstarted_status {
    UNSTARTED_CONVERGED = 0,
    UNSTARTED_NOT_CONVERGED = 1,
    UNSTARTED_UNOBSERVABLE = 2,
    UNSTARTED_INFEASIBLE = 3,
    UNSTARTED_NO_AGREEMENT = 4,
    UNSTARTED_NOT_FINITE = 5,
    UNSTARTED_NO_ROWS = 6,
    UNSTARTED_UNKNOWN_KEY = 7,
    UNSTARTED_UNKNOWN_CASE = 8,
    UNSTARTED_BAD_NOISE = 9,
    UNSTARTED_BAD_BOUNDS = 10,
    UNSTARTED_BAD_START = 11,
    UNSTARTED_NO_START = 12,
    UNSTARTED_NOT_CONNECTED = 13,
    UNSTARTED_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long masts_rows;    /* rows of `masts` */
    const char *const *masts_id;    /* `id` */
    const double *masts_x;    /* `x` */
    const double *masts_y;    /* `y` */
    long ranges_rows;    /* rows of `ranges` */
    const double *ranges_epoch;    /* `epoch` */
    const char *const *ranges_mast;    /* `mast` */
    const double *ranges_r;    /* `r` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
} unstarted_data;

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
} unstarted_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} unstarted_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void unstarted_workspace_size(const unstarted_data *data, unstarted_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int unstarted_solve(const unstarted_data *data, unstarted_result *result, unstarted_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int unstarted_begin(const unstarted_data *data, unstarted_result *result, unstarted_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long unstarted_residual_count(const unstarted_data *data, unstarted_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void unstarted_residuals(const unstarted_data *data, const double *point, double *residuals,
    unstarted_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void unstarted_jacobian(const unstarted_data *data, const double *point, double *jacobian,
    unstarted_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int unstarted_covariance(const unstarted_data *data, const double *point, double *covariance,
    unstarted_workspace *workspace);

/* What a status means. */
const char *unstarted_status_text(int status);

#endif
