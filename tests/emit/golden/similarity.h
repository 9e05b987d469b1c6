#ifndef SIMILARITY__H
#define SIMILARITY__H

/*
 * similarity: A plan laid onto a map.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum similarity_status {
    SIMILARITY_CONVERGED = 0,
    SIMILARITY_NOT_CONVERGED = 1,
    SIMILARITY_UNOBSERVABLE = 2,
    SIMILARITY_INFEASIBLE = 3,
    SIMILARITY_NO_AGREEMENT = 4,
    SIMILARITY_NOT_FINITE = 5,
    SIMILARITY_NO_ROWS = 6,
    SIMILARITY_UNKNOWN_KEY = 7,
    SIMILARITY_UNKNOWN_CASE = 8,
    SIMILARITY_BAD_NOISE = 9,
    SIMILARITY_BAD_BOUNDS = 10,
    SIMILARITY_BAD_START = 11,
    SIMILARITY_NO_START = 12,
    SIMILARITY_NOT_CONNECTED = 13,
    SIMILARITY_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *d_u;    /* `u` */
    const double *d_v;    /* `v` */
    const double *start_S;    /* where S begins: 4 numbers; NULL: as the README says */
} similarity_data;

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
    const double *S;          /* (4) similarity */
    const double *S_sigma;    /* (4) */
} similarity_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} similarity_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void similarity_workspace_size(const similarity_data *data, similarity_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int similarity_solve(const similarity_data *data, similarity_result *result, similarity_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int similarity_begin(const similarity_data *data, similarity_result *result, similarity_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long similarity_residual_count(const similarity_data *data, similarity_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void similarity_residuals(const similarity_data *data, const double *point, double *residuals,
    similarity_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void similarity_jacobian(const similarity_data *data, const double *point, double *jacobian,
    similarity_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int similarity_covariance(const similarity_data *data, const double *point, double *covariance,
    similarity_workspace *workspace);

/* What a status means. */
const char *similarity_status_text(int status);

#endif
