#ifndef JOINED__H
#define JOINED__H

/*
 * joined: Ranges to known places.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum joined_status {
    JOINED_CONVERGED = 0,
    JOINED_NOT_CONVERGED = 1,
    JOINED_UNOBSERVABLE = 2,
    JOINED_INFEASIBLE = 3,
    JOINED_NO_AGREEMENT = 4,
    JOINED_NOT_FINITE = 5,
    JOINED_NO_ROWS = 6,
    JOINED_UNKNOWN_KEY = 7,
    JOINED_UNKNOWN_CASE = 8,
    JOINED_BAD_NOISE = 9,
    JOINED_BAD_BOUNDS = 10,
    JOINED_BAD_START = 11,
    JOINED_NO_START = 12,
    JOINED_NOT_CONNECTED = 13,
    JOINED_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long places_rows;    /* rows of `places` */
    const char *const *places_id;    /* `id` */
    const double *places_x;    /* `x` */
    const double *places_y;    /* `y` */
    long ranges_rows;    /* rows of `ranges` */
    const char *const *ranges_place;    /* `place` */
    const double *ranges_r;    /* `r` */
    const double *start_p;    /* where p begins: 2 numbers; NULL: as the README says */
} joined_data;

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
    const double *p;          /* (2) vector, shown in cm */
    const double *p_sigma;    /* (2) */
} joined_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} joined_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void joined_workspace_size(const joined_data *data, joined_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int joined_solve(const joined_data *data, joined_result *result, joined_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int joined_begin(const joined_data *data, joined_result *result, joined_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long joined_residual_count(const joined_data *data, joined_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void joined_residuals(const joined_data *data, const double *point, double *residuals,
    joined_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void joined_jacobian(const joined_data *data, const double *point, double *jacobian,
    joined_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int joined_covariance(const joined_data *data, const double *point, double *covariance,
    joined_workspace *workspace);

/* What a status means. */
const char *joined_status_text(int status);

#endif
