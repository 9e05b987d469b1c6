#ifndef DERIVED__H
#define DERIVED__H

/*
 * derived: Heights of marks; what is derived of them, once and for each row.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

#ifdef __cplusplus
extern "C" {
#endif

/* What a call answers; `_status_text` has the sentence. */
enum derived_status {
    DERIVED_CONVERGED = 0,
    DERIVED_NOT_CONVERGED = 1,
    DERIVED_UNOBSERVABLE = 2,
    DERIVED_INFEASIBLE = 3,
    DERIVED_NO_AGREEMENT = 4,
    DERIVED_NOT_FINITE = 5,
    DERIVED_NO_ROWS = 6,
    DERIVED_UNKNOWN_KEY = 7,
    DERIVED_UNKNOWN_CASE = 8,
    DERIVED_BAD_NOISE = 9,
    DERIVED_BAD_BOUNDS = 10,
    DERIVED_BAD_START = 11,
    DERIVED_NO_START = 12,
    DERIVED_NOT_CONNECTED = 13,
    DERIVED_WORKSPACE_TOO_SMALL = 14
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
} derived_data;

/* What is answered, in SI; `sigma` are standard deviations. */
typedef struct {
    int status;
    int settled;           /* 0: unknown noise still changed in the last round; sigmas are those of it */
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
    const double *sigmas;        /* of all coordinates; 0: it stays, negative: not determined, at a bound */
    long h_members;
    const long *h_rows;    /* (members) the row of the table that names each */
    const double *h;          /* (members × 1) real, shown in m */
    const double *h_sigma;    /* (members × 1) */
    long climb_rows;    /* the rows of `steps` that count */
    const double *climb;          /* (rows × 1) derived, shown in cm */
    const double *climb_sigma;    /* (rows × 1) */
    const double *top;          /* (1) derived, shown in m */
    const double *top_sigma;    /* (1) */
    const double *both;          /* (2) derived, shown in m */
    const double *both_sigma;    /* (2) */
} derived_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} derived_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void derived_workspace_size(const derived_data *data, derived_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int derived_solve(const derived_data *data, derived_result *result, derived_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int derived_begin(const derived_data *data, derived_result *result, derived_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long derived_residual_count(const derived_data *data, derived_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void derived_residuals(const derived_data *data, const double *point, double *residuals,
    derived_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void derived_jacobian(const derived_data *data, const double *point, double *jacobian,
    derived_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int derived_covariance(const derived_data *data, const double *point, double *covariance,
    derived_workspace *workspace);

/* What a status means. */
const char *derived_status_text(int status);

#ifdef __cplusplus
}
#endif

#endif
