#ifndef KEYS__H
#define KEYS__H

/*
 * keys: A level for each day and a slope; some days are in one table only.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum keys_status {
    KEYS_CONVERGED = 0,
    KEYS_NOT_CONVERGED = 1,
    KEYS_UNOBSERVABLE = 2,
    KEYS_INFEASIBLE = 3,
    KEYS_NO_AGREEMENT = 4,
    KEYS_NOT_FINITE = 5,
    KEYS_NO_ROWS = 6,
    KEYS_UNKNOWN_KEY = 7,
    KEYS_UNKNOWN_CASE = 8,
    KEYS_BAD_NOISE = 9,
    KEYS_BAD_BOUNDS = 10,
    KEYS_BAD_START = 11,
    KEYS_NO_START = 12,
    KEYS_NOT_CONNECTED = 13,
    KEYS_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_day;    /* `day` */
    const double *d_y;    /* `y` */
    long e_rows;    /* rows of `e` */
    const double *e_day;    /* `day` */
    const double *e_z;    /* `z` */
    const double *e_s;    /* `s` */
    const double *start_m;    /* where m begins: a number; NULL: as the README says */
} keys_data;

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
    const double *m;          /* (1) real */
    const double *m_sigma;    /* (1) */
} keys_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} keys_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void keys_workspace_size(const keys_data *data, keys_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int keys_solve(const keys_data *data, keys_result *result, keys_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int keys_begin(const keys_data *data, keys_result *result, keys_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long keys_residual_count(const keys_data *data, keys_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void keys_residuals(const keys_data *data, const double *point, double *residuals,
    keys_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void keys_jacobian(const keys_data *data, const double *point, double *jacobian,
    keys_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int keys_covariance(const keys_data *data, const double *point, double *covariance,
    keys_workspace *workspace);

/* What a status means. */
const char *keys_status_text(int status);

#endif
