#ifndef ROTATION__H
#define ROTATION__H

/*
 * rotation: A frame turned, from directions in it.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum rotation_status {
    ROTATION_CONVERGED = 0,
    ROTATION_NOT_CONVERGED = 1,
    ROTATION_UNOBSERVABLE = 2,
    ROTATION_INFEASIBLE = 3,
    ROTATION_NO_AGREEMENT = 4,
    ROTATION_NOT_FINITE = 5,
    ROTATION_NO_ROWS = 6,
    ROTATION_UNKNOWN_KEY = 7,
    ROTATION_UNKNOWN_CASE = 8,
    ROTATION_BAD_NOISE = 9,
    ROTATION_BAD_BOUNDS = 10,
    ROTATION_BAD_START = 11,
    ROTATION_NO_START = 12,
    ROTATION_NOT_CONNECTED = 13,
    ROTATION_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *d_z;    /* `z` */
    const double *d_u;    /* `u` */
    const double *d_v;    /* `v` */
    const double *d_w;    /* `w` */
    const double *start_R;    /* where R begins: 4 numbers; NULL: as the README says */
} rotation_data;

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
    const double *R;          /* (4) rotation */
    const double *R_sigma;    /* (3) */
} rotation_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} rotation_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void rotation_workspace_size(const rotation_data *data, rotation_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int rotation_solve(const rotation_data *data, rotation_result *result, rotation_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int rotation_begin(const rotation_data *data, rotation_result *result, rotation_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long rotation_residual_count(const rotation_data *data, rotation_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void rotation_residuals(const rotation_data *data, const double *point, double *residuals,
    rotation_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void rotation_jacobian(const rotation_data *data, const double *point, double *jacobian,
    rotation_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int rotation_covariance(const rotation_data *data, const double *point, double *covariance,
    rotation_workspace *workspace);

/* What a status means. */
const char *rotation_status_text(int status);

#endif
