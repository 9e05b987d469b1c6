#ifndef RIM__H
#define RIM__H

/*
 * rim: A circle through points with errors in both coordinates: equations without a measured side.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum rim_status {
    RIM_CONVERGED = 0,
    RIM_NOT_CONVERGED = 1,
    RIM_UNOBSERVABLE = 2,
    RIM_INFEASIBLE = 3,
    RIM_NO_AGREEMENT = 4,
    RIM_NOT_FINITE = 5,
    RIM_NO_ROWS = 6,
    RIM_UNKNOWN_KEY = 7,
    RIM_UNKNOWN_CASE = 8,
    RIM_BAD_NOISE = 9,
    RIM_BAD_BOUNDS = 10,
    RIM_BAD_START = 11,
    RIM_NO_START = 12,
    RIM_NOT_CONNECTED = 13,
    RIM_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *start_c;    /* where c begins: 2 numbers; NULL: as the README says */
    const double *start_r;    /* where r begins: a number; NULL: as the README says */
    const double *start_d_x;    /* where d.x begins: a number for each member; NULL: as the README says */
    const double *start_d_y;    /* where d.y begins: a number for each member; NULL: as the README says */
} rim_data;

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
    const double *c;          /* (2) vector */
    const double *c_sigma;    /* (2) */
    const double *r;          /* (1) real */
    const double *r_sigma;    /* (1) */
    long d_x_members;
    const long *d_x_rows;    /* (members) the row of the table that names each */
    const double *d_x;          /* (members × 1) real: true values of the column x, which is measured with errors */
    const double *d_x_sigma;    /* (members × 1) */
    long d_y_members;
    const long *d_y_rows;    /* (members) the row of the table that names each */
    const double *d_y;          /* (members × 1) real: true values of the column y, which is measured with errors */
    const double *d_y_sigma;    /* (members × 1) */
} rim_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} rim_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void rim_workspace_size(const rim_data *data, rim_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int rim_solve(const rim_data *data, rim_result *result, rim_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int rim_begin(const rim_data *data, rim_result *result, rim_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long rim_residual_count(const rim_data *data, rim_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void rim_residuals(const rim_data *data, const double *point, double *residuals,
    rim_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void rim_jacobian(const rim_data *data, const double *point, double *jacobian,
    rim_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int rim_covariance(const rim_data *data, const double *point, double *covariance,
    rim_workspace *workspace);

/* What a status means. */
const char *rim_status_text(int status);

#endif
