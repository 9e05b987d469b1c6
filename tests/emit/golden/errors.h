#ifndef ERRORS__H
#define ERRORS__H

/*
 * errors: Both coordinates of a line are measured with errors.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum errors_status {
    ERRORS_CONVERGED = 0,
    ERRORS_NOT_CONVERGED = 1,
    ERRORS_UNOBSERVABLE = 2,
    ERRORS_INFEASIBLE = 3,
    ERRORS_NO_AGREEMENT = 4,
    ERRORS_NOT_FINITE = 5,
    ERRORS_NO_ROWS = 6,
    ERRORS_UNKNOWN_KEY = 7,
    ERRORS_UNKNOWN_CASE = 8,
    ERRORS_BAD_NOISE = 9,
    ERRORS_BAD_BOUNDS = 10,
    ERRORS_BAD_START = 11,
    ERRORS_NO_START = 12,
    ERRORS_NOT_CONNECTED = 13,
    ERRORS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *d_s;    /* `s` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
    const double *start_d_x;    /* where d.x begins: a number for each member; NULL: as the README says */
} errors_data;

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
    long d_x_members;
    const long *d_x_rows;    /* (members) the row of the table that names each */
    const double *d_x;          /* (members × 1) real: true values of the column x, which is measured with errors */
    const double *d_x_sigma;    /* (members × 1) */
} errors_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} errors_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void errors_workspace_size(const errors_data *data, errors_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int errors_solve(const errors_data *data, errors_result *result, errors_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int errors_begin(const errors_data *data, errors_result *result, errors_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long errors_residual_count(const errors_data *data, errors_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void errors_residuals(const errors_data *data, const double *point, double *residuals,
    errors_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void errors_jacobian(const errors_data *data, const double *point, double *jacobian,
    errors_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int errors_covariance(const errors_data *data, const double *point, double *covariance,
    errors_workspace *workspace);

/* What a status means. */
const char *errors_status_text(int status);

#endif
