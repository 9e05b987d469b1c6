#ifndef HELD__H
#define HELD__H

/*
 * held: Consensus about a parabola that goes through a point.
 *
 * Written by mbm 0.1.0. Everything is in SI, angles in radians. Calls share nothing but their
 * arguments, so that threads may solve at the same time, each with a workspace of its own.
 */

/* What a call answers; `_status_text` has the sentence. */
enum held_status {
    HELD_CONVERGED = 0,
    HELD_NOT_CONVERGED = 1,
    HELD_UNOBSERVABLE = 2,
    HELD_INFEASIBLE = 3,
    HELD_NO_AGREEMENT = 4,
    HELD_NOT_FINITE = 5,
    HELD_NO_ROWS = 6,
    HELD_UNKNOWN_KEY = 7,
    HELD_UNKNOWN_CASE = 8,
    HELD_BAD_NOISE = 9,
    HELD_BAD_BOUNDS = 10,
    HELD_BAD_START = 11,
    HELD_NO_START = 12,
    HELD_NOT_CONNECTED = 13,
    HELD_WORKSPACE_TOO_SMALL = 14
};

/* What is given: columns of tables, one element per row, in SI. */
typedef struct {
    long d_rows;    /* rows of `d` */
    const double *d_x;    /* `x` */
    const double *d_y;    /* `y` */
    const double *start_a;    /* where a begins: a number; NULL: as the README says */
    const double *start_b;    /* where b begins: a number; NULL: as the README says */
    const double *start_c;    /* where c begins: a number; NULL: as the README says */
} held_data;

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
    const double *a;          /* (1) real */
    const double *a_sigma;    /* (1) */
    const double *b;          /* (1) real */
    const double *b_sigma;    /* (1) */
    const double *c;          /* (1) real */
    const double *c_sigma;    /* (1) */
} held_result;

/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */
typedef struct {
    double *reals;
    long reals_size;
    long *integers;
    long integers_size;
} held_workspace;

/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */
void held_workspace_size(const held_data *data, held_workspace *workspace);

/* Solves; the answer is also in `result->status`. Allocates nothing. */
int held_solve(const held_data *data, held_result *result, held_workspace *workspace);

/* Prepares the equations without solving: `result` then has the start, and where everything stands. */
int held_begin(const held_data *data, held_result *result, held_workspace *workspace);

/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */
long held_residual_count(const held_data *data, held_workspace *workspace);

/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */
void held_residuals(const held_data *data, const double *point, double *residuals,
    held_workspace *workspace);

/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */
void held_jacobian(const held_data *data, const double *point, double *jacobian,
    held_workspace *workspace);

/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */
int held_covariance(const held_data *data, const double *point, double *covariance,
    held_workspace *workspace);

/* What a status means. */
const char *held_status_text(int status);

#endif
