#ifndef POSE__H
#define POSE__H

/*
 * pose: Where a camera frame is, and which way a vector points.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum pose_status {
    POSE_CONVERGED = 0,
    POSE_NOT_CONVERGED = 1,
    POSE_UNOBSERVABLE = 2,
    POSE_INFEASIBLE = 3,
    POSE_NO_AGREEMENT = 4,
    POSE_NOT_FINITE = 5,
    POSE_NO_ROWS = 6,
    POSE_UNKNOWN_KEY = 7,
    POSE_UNKNOWN_CASE = 8,
    POSE_BAD_NOISE = 9,
    POSE_BAD_BOUNDS = 10,
    POSE_BAD_START = 11,
    POSE_NO_START = 12,
    POSE_NOT_CONNECTED = 13,
    POSE_WORKSPACE_TOO_SMALL = 14
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
    long e_rows;    /* rows of `e` */
    const double *e_s;    /* `s` */
    const double *start_T;    /* where T begins: 7 numbers; NULL: as the README says */
    const double *start_n;    /* where n begins: 3 numbers; NULL: as the README says */
} pose_data;

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
    const double *T;          /* (7) pose, shown in m */
    const double *T_sigma;    /* (6) */
    const double *n;          /* (3) direction */
    const double *n_sigma;    /* (2) */
} pose_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} pose_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void pose_workspace_size(const pose_data *data, pose_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int pose_solve(const pose_data *data, pose_result *result, pose_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int pose_begin(const pose_data *data, pose_result *result, pose_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long pose_residual_count(const pose_data *data, pose_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void pose_residuals(const pose_data *data, const double *point, double *residuals,
    pose_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void pose_jacobian(const pose_data *data, const double *point, double *jacobian,
    pose_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int pose_covariance(const pose_data *data, const double *point, double *covariance,
    pose_workspace *workspace);

/* What a status means. */
const char *pose_status_text(int status);

#endif
