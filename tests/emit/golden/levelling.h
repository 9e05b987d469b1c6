#ifndef LEVELLING__H
#define LEVELLING__H

/*
 * levelling: Heights of marks; one step is wrong.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum levelling_status {
    LEVELLING_CONVERGED = 0,
    LEVELLING_NOT_CONVERGED = 1,
    LEVELLING_UNOBSERVABLE = 2,
    LEVELLING_INFEASIBLE = 3,
    LEVELLING_NO_AGREEMENT = 4,
    LEVELLING_NOT_FINITE = 5,
    LEVELLING_NO_ROWS = 6,
    LEVELLING_UNKNOWN_KEY = 7,
    LEVELLING_UNKNOWN_CASE = 8,
    LEVELLING_BAD_NOISE = 9,
    LEVELLING_BAD_BOUNDS = 10,
    LEVELLING_BAD_START = 11,
    LEVELLING_NO_START = 12,
    LEVELLING_NOT_CONNECTED = 13,
    LEVELLING_WORKSPACE_TOO_SMALL = 14
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
    const double *start_h;    /* where h begins: a number for each member; NULL: as the README says */
} levelling_data;

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
    long units, inliers;   /* equations of rows that were looked at, and those that agree */
    int ambiguous;         /* 1: another solution explains the data as well */
    const long *inside;    /* (units) 1: it agrees; clause by clause, row by row, then by equation */
    long h_members;
    const long *h_rows;    /* (members) the row of the table that names each */
    const double *h;          /* (members × 1) real, shown in m */
    const double *h_sigma;    /* (members × 1) */
} levelling_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} levelling_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void levelling_workspace_size(const levelling_data *data, levelling_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int levelling_solve(const levelling_data *data, levelling_result *result, levelling_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int levelling_begin(const levelling_data *data, levelling_result *result, levelling_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long levelling_residual_count(const levelling_data *data, levelling_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void levelling_residuals(const levelling_data *data, const double *point, double *residuals,
    levelling_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void levelling_jacobian(const levelling_data *data, const double *point, double *jacobian,
    levelling_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int levelling_covariance(const levelling_data *data, const double *point, double *covariance,
    levelling_workspace *workspace);

/* What a status means. */
const char *levelling_status_text(int status);

#endif
