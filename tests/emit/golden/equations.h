#ifndef EQUATIONS__H
#define EQUATIONS__H

/*
 * equations: Three angles that add up.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum equations_status {
    EQUATIONS_CONVERGED = 0,
    EQUATIONS_NOT_CONVERGED = 1,
    EQUATIONS_UNOBSERVABLE = 2,
    EQUATIONS_INFEASIBLE = 3,
    EQUATIONS_NO_AGREEMENT = 4,
    EQUATIONS_NOT_FINITE = 5,
    EQUATIONS_NO_ROWS = 6,
    EQUATIONS_UNKNOWN_KEY = 7,
    EQUATIONS_UNKNOWN_CASE = 8,
    EQUATIONS_BAD_NOISE = 9,
    EQUATIONS_BAD_BOUNDS = 10,
    EQUATIONS_BAD_START = 11,
    EQUATIONS_NO_START = 12,
    EQUATIONS_NOT_CONNECTED = 13,
    EQUATIONS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_corner;    /* `corner` */
    const double *d_angle;    /* `angle` */
    const double *start_q;    /* where q begins: 3 numbers; NULL: as the README says */
} equations_data;

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
    const double *q;          /* (3) array */
    const double *q_sigma;    /* (3) */
} equations_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} equations_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void equations_workspace_size(const equations_data *data, equations_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int equations_solve(const equations_data *data, equations_result *result, equations_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int equations_begin(const equations_data *data, equations_result *result, equations_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long equations_residual_count(const equations_data *data, equations_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void equations_residuals(const equations_data *data, const double *point, double *residuals,
    equations_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void equations_jacobian(const equations_data *data, const double *point, double *jacobian,
    equations_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int equations_covariance(const equations_data *data, const double *point, double *covariance,
    equations_workspace *workspace);

/* What a status means. */
const char *equations_status_text(int status);

#endif
