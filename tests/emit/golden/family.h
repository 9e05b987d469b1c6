#ifndef FAMILY__H
#define FAMILY__H

/*
 * family: Heights of marks from differences; one mark is known, one is no part of it.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum family_status {
    FAMILY_CONVERGED = 0,
    FAMILY_NOT_CONVERGED = 1,
    FAMILY_UNOBSERVABLE = 2,
    FAMILY_INFEASIBLE = 3,
    FAMILY_NO_AGREEMENT = 4,
    FAMILY_NOT_FINITE = 5,
    FAMILY_NO_ROWS = 6,
    FAMILY_UNKNOWN_KEY = 7,
    FAMILY_UNKNOWN_CASE = 8,
    FAMILY_BAD_NOISE = 9,
    FAMILY_BAD_BOUNDS = 10,
    FAMILY_BAD_START = 11,
    FAMILY_NO_START = 12,
    FAMILY_NOT_CONNECTED = 13,
    FAMILY_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long marks_rows;    /* rows of `marks` */
    const char *const *marks_id;    /* `id` */
    const double *marks_height;    /* `height` */
    const double *marks_known;    /* `known` */
    long steps_rows;    /* rows of `steps` */
    const char *const *steps_from_;    /* `from` */
    const char *const *steps_to;    /* `to` */
    const double *steps_rise;    /* `rise` */
    const double *steps_s;    /* `s` */
    const double *start_h;    /* where h begins: a number for each member; NULL: as the README says */
} family_data;

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
    long h_members;
    const long *h_rows;    /* (members) the row of the table that names each */
    const double *h;          /* (members × 1) real, shown in m */
    const double *h_sigma;    /* (members × 1) */
} family_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} family_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void family_workspace_size(const family_data *data, family_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int family_solve(const family_data *data, family_result *result, family_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int family_begin(const family_data *data, family_result *result, family_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long family_residual_count(const family_data *data, family_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void family_residuals(const family_data *data, const double *point, double *residuals,
    family_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void family_jacobian(const family_data *data, const double *point, double *jacobian,
    family_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int family_covariance(const family_data *data, const double *point, double *covariance,
    family_workspace *workspace);

/* What a status means. */
const char *family_status_text(int status);

#endif
