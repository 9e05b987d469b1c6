/* errors: from tables to the arrays of the solver, and back. */

#include "errors.h"

#include <stddef.h>
#include <string.h>

#include "errors_kernels.h"
#include "errors_solver.h"

/* How the solver's description of the equations begins: what no data change. */
static const long SYSTEM[80] = {
    0, 0, 0, 2, 0, 0, 0, 0, 100, 0, 0, 0, 0, 32, 0, 0, 0, 24, 0, 0, 0, 0, 0, 0, 0, 1, 1, 3, 1, 3, 3, 3, 3, 1,
    1, 32, 38, -1, 47, 0, 2, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 31, 37, -1, 40, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1,
    0, 0, 2, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0
};

/* Of each unknown: numbers, coordinates, family, positive, pieces. */
static const long UNKNOWNS[27] = {
    1, 1, 0, 0, 1, 18, 1, 1, 0, 0, 1, 21, 1, 1, 1, 0, 1, 24, 0, 0, 0, 0, 0, 0, 0, 0, 0
};

/* Parameter and shape of each loss. */
static const double LOSSES[1] = {
    0.0
};

static const double TOLERANCE = 1e-10;    /* of the next step, in standard deviations */

/* Arrays of one data set, taken from the caller's workspace one after the other; nothing is allocated. */
struct arena {
    double *reals;
    long reals_used;
    long *integers;
    long integers_used;
};

static double *reals_of(struct arena *a, long count)
{
    double *found = a->reals != NULL ? a->reals + a->reals_used : NULL;
    a->reals_used += count;
    return found;
}

static long *integers_of(struct arena *a, long count)
{
    long *found = a->integers != NULL ? a->integers + a->integers_used : NULL;
    a->integers_used += count;
    return found;
}

struct frame {
    const errors_data *data;
    long members[3];        /* of each unknown; 1 without a family */
    long offsets[4];        /* where the numbers of each unknown begin */
    long firsts[4];         /* where its coordinates begin */
    long data_numbers[11];      /* of `data_set` */
    long *d_x_of_d;    /* the member that each row names */
    long *d_members;    /* a row of `d` for each member */
    long d_members_count;
    long *chosen, *fixed, *used, *column, *index, *columns, *sides, *coordinates;
    struct problem *system;
    struct work work;
    struct data_set *data_set;    /* as the solver wants it */
    long parameters_used, weights_used, index_used, columns_used;
    double *parameters, *weights, *scratch, *start, *lower, *upper, *constants, *point, *sigma;
    double *triangle, *covariance, *multipliers, *spare;
    double kappa[2];    /* of each kind of unit: what limits leave */
    double results[8];
    long states[8];
};

/* Lays out a frame for the rows of `data`: the most that can be needed. */
static void lay_out(struct frame *f, const errors_data *data, struct arena *a)
{
    long n, numbers, residuals = 4, inputs = 0, weights = 0, multipliers = 0, i;
    long parameters = 0, index = 0, columns = 0, chosen = 1;
    struct problem header = {0};

    f->data = data;
    f->d_x_of_d = integers_of(a, data->d_rows);
    f->d_members = integers_of(a, data->d_rows);
    f->members[0] = 1;
    f->members[1] = 1;
    f->members[2] = data->d_rows;
    place_unknowns(UNKNOWNS, 3, f->members, f->offsets, f->firsts);
    numbers = f->offsets[3];
    n = f->firsts[3];
    /* d */
    chosen = chosen < data->d_rows ? data->d_rows : chosen;
    parameters += data->d_rows * 1;
    residuals += data->d_rows * 1;
    inputs += data->d_rows * 4;
    index += (data->d_rows + 1) * 3;
    columns += (data->d_rows + 1) * 3;
    weights += data->d_rows * 1;
    /* d.x */
    chosen = chosen < data->d_rows ? data->d_rows : chosen;
    parameters += data->d_rows * 1;
    residuals += data->d_rows * 1;
    inputs += data->d_rows * 2;
    index += (data->d_rows + 1) * 1;
    columns += (data->d_rows + 1) * 1;
    weights += data->d_rows * 1;
    f->chosen = integers_of(a, chosen + 1);
    f->index = integers_of(a, index + 1);
    f->columns = integers_of(a, columns + 1);
    f->fixed = integers_of(a, n + 1);
    f->used = integers_of(a, n + 1);
    f->column = integers_of(a, n + 1);
    f->sides = integers_of(a, n + 1);
    f->coordinates = integers_of(a, n + 1);
    f->system = (struct problem *)integers_of(a, 80 + (2 + 8) * n);
    f->parameters = reals_of(a, parameters + 1);
    f->weights = reals_of(a, weights + 1);
    f->scratch = reals_of(a, 1);
    f->start = reals_of(a, numbers);
    f->point = reals_of(a, numbers);
    f->lower = reals_of(a, n);
    f->upper = reals_of(a, n);
    f->sigma = reals_of(a, n);
    f->constants = reals_of(a, 8 + 2 * n);
    f->triangle = reals_of(a, (n + 1) * (n + 1));
    f->covariance = reals_of(a, n * n);
    f->multipliers = reals_of(a, multipliers + 1);
    header.numbers = numbers;
    header.n = n;
    header.most_multipliers = multipliers;
    header.most_residuals = residuals;
    header.most_inputs = inputs;
    header.most_weights = weights + 2 * multipliers;
    header.chunk = 32;
    header.most_outputs = 128;
    f->work.reals = reals_of(a, work_reals(&header));
    f->spare = reals_of(a, 12 + 2 * n);
    f->work.integers = integers_of(a, work_integers(&header));
    f->parameters_used = f->weights_used = f->index_used = f->columns_used = 0;
    for (i = 0; i < 11; i++)
        f->data_numbers[i] = 0;
    f->data_set = (struct data_set *)f->data_numbers;
}

/* The place of a key among numbers; without `cells` rows are named by their number, from 1. */
static long place_of_number(double key, const double *cells, const long *rows, long count, long last)
{
    long i;
    for (i = 0; i < count; i++) {
        const long place = (last + 1 + i) % count;
        const long row = rows != NULL ? rows[place] : place;
        if ((cells != NULL ? cells[row] : (double)(row + 1)) == key)
            return place;
    }
    return -1;
}

/* The rows that count, the members of families, and what the keys name. */
static int find_rows(struct frame *f)
{
    const errors_data *data = f->data;
    long row, last;

    (void)data;
    /* the members: rows of `d` */
    f->d_members_count = 0;
    for (row = 0; row < data->d_rows; row++) {
        f->d_members[f->d_members_count++] = row;
    }
    f->members[2] = f->d_members_count;    /* d.x */
    /* the member that each row of `d` names */
    last = -1;
    for (row = 0; row < data->d_rows; row++) {
        last = place_of_number((double)(row + 1), NULL, f->d_members, f->d_members_count, last);
        if (last < 0)
            return ERRORS_UNKNOWN_KEY;
        f->d_x_of_d[row] = last;
    }
    return 0;
}

/* `a`. */
static int set_up_a(struct frame *f)
{
    const errors_data *data = f->data;
    double inputs[1];
    double stated[1];
    double lower[1], upper[1];
    long m, c;

    (void)stated;
    inputs[0] = 0.0;
    for (m = 0; m < f->members[0]; m++) {
        const long number = f->offsets[0] + m * 1;
        const long first = f->firsts[0] + m * 1;
        for (c = 0; c < 1; c++) {
            lower[c] = -HUGE_VAL;
            upper[c] = HUGE_VAL;
        }
        for (c = 0; c < 1; c++) {
            if (!(lower[c] < upper[c]))
                return ERRORS_BAD_BOUNDS;
            f->lower[first + c] = lower[c];
            f->upper[first + c] = upper[c];
            f->fixed[first + c] = 0;
        }
        if (data->start_a != NULL) {
            for (c = 0; c < 1; c++)
                f->start[number + c] = data->start_a[m * 1 + c];
            continue;
        }
        start_of_a(inputs, stated);
        for (c = 0; c < 1; c++) {
            const double found = begun(stated[c], -HUGE_VAL, HUGE_VAL, lower[c], upper[c]);
            f->start[number + c] = found;
        }
    }
    return 0;
}

/* `b`. */
static int set_up_b(struct frame *f)
{
    const errors_data *data = f->data;
    double inputs[1];
    double stated[1];
    double lower[1], upper[1];
    long m, c;

    (void)stated;
    inputs[0] = 0.0;
    for (m = 0; m < f->members[1]; m++) {
        const long number = f->offsets[1] + m * 1;
        const long first = f->firsts[1] + m * 1;
        for (c = 0; c < 1; c++) {
            lower[c] = -HUGE_VAL;
            upper[c] = HUGE_VAL;
        }
        for (c = 0; c < 1; c++) {
            if (!(lower[c] < upper[c]))
                return ERRORS_BAD_BOUNDS;
            f->lower[first + c] = lower[c];
            f->upper[first + c] = upper[c];
            f->fixed[first + c] = 0;
        }
        if (data->start_b != NULL) {
            for (c = 0; c < 1; c++)
                f->start[number + c] = data->start_b[m * 1 + c];
            continue;
        }
        start_of_b(inputs, stated);
        for (c = 0; c < 1; c++) {
            const double found = begun(stated[c], -HUGE_VAL, HUGE_VAL, lower[c], upper[c]);
            f->start[number + c] = found;
        }
    }
    return 0;
}

/* `d.x`: true values of the column x, which is measured with errors. */
static int set_up_d_x(struct frame *f)
{
    const errors_data *data = f->data;
    double inputs[1];
    double stated[1];
    double lower[1], upper[1];
    long m, c;

    (void)stated;
    for (m = 0; m < f->members[2]; m++) {
        const long row = f->d_members[m];
        const long number = f->offsets[2] + m * 1;
        const long first = f->firsts[2] + m * 1;
        (void)row;
        for (c = 0; c < 1; c++) {
            lower[c] = -HUGE_VAL;
            upper[c] = HUGE_VAL;
        }
        for (c = 0; c < 1; c++) {
            if (!(lower[c] < upper[c]))
                return ERRORS_BAD_BOUNDS;
            f->lower[first + c] = lower[c];
            f->upper[first + c] = upper[c];
            f->fixed[first + c] = 0;
        }
        if (data->start_d_x != NULL) {
            for (c = 0; c < 1; c++)
                f->start[number + c] = data->start_d_x[m * 1 + c];
            continue;
        }
        inputs[0] = data->d_x[row];
        start_of_d_x(inputs, stated);
        for (c = 0; c < 1; c++) {
            const double found = begun(stated[c], -HUGE_VAL, HUGE_VAL, lower[c], upper[c]);
            f->start[number + c] = found;
        }
    }
    return 0;
}

/* Starts, bounds and what stays, of all unknowns. */
static int set_up(struct frame *f)
{
    int status = 0;

    if (status == 0)
        status = set_up_a(f);
    if (status == 0)
        status = set_up_b(f);
    if (status == 0)
        status = set_up_d_x(f);
    return status;
}

/* The rows of `d` that d is about. */
static int d_rows(struct frame *f, long *count)
{
    const errors_data *data = f->data;
    long row;

    (void)data;
    *count = 0;
    for (row = 0; row < data->d_rows; row++) {
        f->chosen[(*count)++] = row;
    }
    return 0;
}

/* Parameters, weights and unknowns of the rows of d: kernel 0. */
static int d_assemble(struct frame *f, long count)
{
    const errors_data *data = f->data;
    double inputs[1], noise[1];
    struct data_block *own = &blocks_of_data_set(f->data_set)[0];
    long i, rows = 0;

    (void)data;
    own->parameters = f->parameters_used;
    own->weights = f->weights_used;
    own->index = f->index_used;
    own->columns = f->columns_used;
    for (i = 0; i < count; i++) {
        const long row = f->chosen[i];
        f->parameters[f->parameters_used++] = data->d_y[row];
        inputs[0] = data->d_s[row];
        d_noise(inputs, noise);
        if (!weight_of_sigma(noise[0], f->weights + f->weights_used + 0))
            return -1;
        f->weights_used += 1;
        f->index[f->index_used++] = f->offsets[0];    /* a */
        f->index[f->index_used++] = f->offsets[1];    /* b */
        f->index[f->index_used++] = f->offsets[2] + f->d_x_of_d[row] * 1;    /* d.x */
        f->columns[f->columns_used++] = f->firsts[0];    /* a */
        f->columns[f->columns_used++] = f->firsts[1];    /* b */
        f->columns[f->columns_used++] = f->firsts[2] + f->d_x_of_d[row] * 1;    /* d.x */
        rows++;
    }
    own->rows = rows;
    return (int)rows;
}

/* The rows of `d` that d.x is about. */
static int d_x_rows(struct frame *f, long *count)
{
    const errors_data *data = f->data;
    long row;

    (void)data;
    *count = 0;
    for (row = 0; row < data->d_rows; row++) {
        f->chosen[(*count)++] = row;
    }
    return 0;
}

/* Parameters, weights and unknowns of the rows of d_x: kernel 1. */
static int d_x_assemble(struct frame *f, long count)
{
    const errors_data *data = f->data;
    double inputs[1], noise[1];
    struct data_block *own = &blocks_of_data_set(f->data_set)[1];
    long i, rows = 0;

    (void)data;
    inputs[0] = 0.0;
    own->parameters = f->parameters_used;
    own->weights = f->weights_used;
    own->index = f->index_used;
    own->columns = f->columns_used;
    for (i = 0; i < count; i++) {
        const long row = f->chosen[i];
        f->parameters[f->parameters_used++] = data->d_x[row];
        d_x_noise(inputs, noise);
        if (!weight_of_sigma(noise[0], f->weights + f->weights_used + 0))
            return -1;
        f->weights_used += 1;
        f->index[f->index_used++] = f->offsets[2] + f->d_x_of_d[row] * 1;    /* d.x */
        f->columns[f->columns_used++] = f->firsts[2] + f->d_x_of_d[row] * 1;    /* d.x */
        rows++;
    }
    own->rows = rows;
    return (int)rows;
}

/* All clauses: the rows that they use, each in the case that its values ask for. */
static int assemble(struct frame *f)
{
    long count;
    int rows, all, status = 0;

    /* observation d */
    status = d_rows(f, &count);
    if (status != 0)
        return status;
    all = 0;
    rows = d_assemble(f, count);
    if (rows < 0)
        return ERRORS_BAD_NOISE;
    all += rows;
    if (all != count)
        return ERRORS_UNKNOWN_CASE;
    /* observation d.x */
    status = d_x_rows(f, &count);
    if (status != 0)
        return status;
    all = 0;
    rows = d_x_assemble(f, count);
    if (rows < 0)
        return ERRORS_BAD_NOISE;
    all += rows;
    if (all != count)
        return ERRORS_UNKNOWN_CASE;
    return status;
}


/* Everything of a data set that the solver is handed. */
static int prepare(struct frame *f, const errors_data *data,
    errors_workspace *workspace)
{
    struct arena a = {0};
    long b, c, count;
    int status;

    lay_out(f, data, &a);
    if (a.reals_used > workspace->reals_size || a.integers_used > workspace->integers_size)
        return ERRORS_WORKSPACE_TOO_SMALL;
    a.reals = workspace->reals;
    a.integers = workspace->integers;
    a.reals_used = a.integers_used = 0;
    lay_out(f, data, &a);
    status = find_rows(f);
    if (status != 0)
        return status;
    place_unknowns(UNKNOWNS, 3, f->members, f->offsets, f->firsts);
    status = set_up(f);
    if (status == 0)
        status = assemble(f);
    if (status != 0)
        return status;
    for (c = 0; c < 80; c++)
        ((long *)f->system)[c] = SYSTEM[c];
    count = f->firsts[3];
    for (c = 0; c < count; c++)
        f->used[c] = 0;
    for (b = 0; b < 2; b++) {
        const struct data_block *own = &blocks_of_data_set(f->data_set)[b];
        mark_used(&blocks_of_problem(f->system)[b], own->rows, f->columns + own->columns, f->used);
    }
    c = free_coordinates(UNKNOWNS, 3, f->members, f->firsts, f->used, f->fixed, f->column);
    renumber(f->columns_used, f->column, f->columns);
    set_coordinates((long *)f->system, 80, c, UNKNOWNS, 3, f->members, f->offsets,
        f->firsts, f->column);
    f->data_set->count = set_capacities(f->system, f->data_set);
    set_constants(f->system, f->constants, count, f->column, f->lower, f->upper, TOLERANCE, LOSSES);
    share_out(f->system, &f->work);
    f->work.constants = f->constants;
    f->work.data = f->data_set;
    f->work.index = f->index;
    f->work.columns = f->columns;
    for (b = 0; b < count; b++)
        if (f->column[b] >= 0)
            f->coordinates[f->column[b]] = b;
    for (b = 0; b < 2; b++)
        f->kappa[b] = 1.0;
    return 0;
}

/* Where the answer stands; `sigma` of what is not determined is negative, of what stays 0. */
static void answer(struct frame *f, errors_result *result)
{
    const long n = f->system->n, all = f->firsts[3];
    long c;

    if (f->states[4] != 0)
        mask_undetermined(f->system, &f->work, f->covariance);
    for (c = 0; c < all; c++)
        f->sigma[c] = f->fixed[c] ? 0.0 : -1.0;
    for (c = 0; c < n; c++) {
        const double variance = f->covariance[c * n + c];
        f->sigma[f->coordinates[c]] = variance >= 0.0 ? sqrt(variance) : -1.0;
    }
    result->numbers = f->offsets[3];
    result->point = f->point;
    result->free = n;
    result->coordinates = f->coordinates;
    result->covariance = f->covariance;
    result->sigmas = f->sigma;
    result->a = f->point + f->offsets[0];
    result->a_sigma = f->sigma + f->firsts[0];
    result->b = f->point + f->offsets[1];
    result->b_sigma = f->sigma + f->firsts[1];
    result->d_x_members = f->members[2];
    result->d_x_rows = f->d_members;
    result->d_x = f->point + f->offsets[2];
    result->d_x_sigma = f->sigma + f->firsts[2];
}

/* What the reason of the solver means to the caller. */
static int status_of(const struct frame *f)
{
    const long reason = f->states[0];

    if (reason == 7)
        return ERRORS_NOT_FINITE;
    if (reason == 9)
        return ERRORS_INFEASIBLE;
    if (f->states[4] != 0)
        return ERRORS_UNOBSERVABLE;
    if (reason < 1 || reason > 4)
        return ERRORS_NOT_CONVERGED;
    return ERRORS_CONVERGED;
}

void errors_workspace_size(const errors_data *data, errors_workspace *workspace)
{
    struct frame f;
    struct arena a = {0};

    lay_out(&f, data, &a);
    workspace->reals_size = a.reals_used;
    workspace->integers_size = a.integers_used;
}

int errors_solve(const errors_data *data, errors_result *result, errors_workspace *workspace)
{
    struct frame frame, *f = &frame;
    double factors[1];
    long c, n;

    result->status = prepare(f, data, workspace);
    if (result->status != 0)
        return result->status;
    n = f->system->n;
    for (c = 0; c < 1; c++)
        factors[c] = 1.0;
    solve_noises(f->system, f->constants, f->parameters, f->weights, f->index, f->columns, f->data_set,
        f->start, &f->work, f->point, f->results, f->states, f->sides, f->triangle, f->covariance,
        f->multipliers, f->kappa, factors, f->spare);
    result->cost = f->results[2];
    result->status = status_of(f);
    result->iterations = f->states[1];
    result->evaluations = f->states[2];
    result->robust_cost = f->results[0];
    result->freedom = f->states[3];
    result->sigma0 = result->freedom > 0 ? sqrt(result->cost / (double)result->freedom) : 0.0;
    (void)n;
    answer(f, result);
    return result->status;
}

int errors_begin(const errors_data *data, errors_result *result, errors_workspace *workspace)
{
    struct frame frame, *f = &frame;
    long c, n;

    memset(result, 0, sizeof *result);
    result->status = prepare(f, data, workspace);
    if (result->status != 0)
        return result->status;
    n = f->system->n;
    for (c = 0; c < n * n; c++)
        f->covariance[c] = NAN;
    for (c = 0; c < f->system->numbers; c++)
        f->point[c] = f->start[c];
    f->states[4] = 0;
    answer(f, result);
    return result->status;
}

long errors_residual_count(const errors_data *data, errors_workspace *workspace)
{
    struct frame f;

    return prepare(&f, data, workspace) == 0 ? f.data_set->count : 0;
}

void errors_residuals(const errors_data *data, const double *point, double *residuals,
    errors_workspace *workspace)
{
    struct frame frame, *f = &frame;

    if (prepare(f, data, workspace) != 0)
        return;
    all_rows(f->system, f->data_set, f->parameters, f->weights, f->index, f->columns, point, 0,
        f->spare, f->spare + row_scratch(f->system), residuals);
}

void errors_jacobian(const errors_data *data, const double *point, double *jacobian,
    errors_workspace *workspace)
{
    struct frame frame, *f = &frame;

    if (prepare(f, data, workspace) != 0)
        return;
    all_rows(f->system, f->data_set, f->parameters, f->weights, f->index, f->columns, point, 1,
        f->spare, f->spare + row_scratch(f->system), jacobian);
}

int errors_covariance(const errors_data *data, const double *point, double *covariance,
    errors_workspace *workspace)
{
    struct frame frame, *f = &frame;
    long c;

    if (prepare(f, data, workspace) != 0)
        return 0;
    load_rows(f->system, f->data_set, f->parameters, f->weights, f->work.rows);
    sweep(f->system, point, 0, 0, &f->work, f->constants, f->triangle);
    for (c = 0; c < f->system->n; c++)
        f->sides[c] = 0;
    c = set_covariance(f->system, f->triangle, f->sides, 0, f->constants, &f->work, covariance)
        < 1e300;
    mask_undetermined(f->system, &f->work, covariance);
    return (int)c;
}

const char *errors_status_text(int status)
{
    switch (status) {
    case ERRORS_CONVERGED:
        return "converged";
    case ERRORS_NOT_CONVERGED:
        return "not converged: the estimates should not be trusted";
    case ERRORS_UNOBSERVABLE:
        return "the data do not determine all unknowns";
    case ERRORS_INFEASIBLE:
        return "no point meets all constraints";
    case ERRORS_NO_AGREEMENT:
        return "fewer than half of the measurements agree with any one solution";
    case ERRORS_NOT_FINITE:
        return "an equation has no finite value at the start";
    case ERRORS_NO_ROWS:
        return "a table that one row is wanted of has none";
    case ERRORS_UNKNOWN_KEY:
        return "a key names no row or member";
    case ERRORS_UNKNOWN_CASE:
        return "a row has values that no row had when the solver was made";
    case ERRORS_BAD_NOISE:
        return "a standard deviation is not above zero, or a matrix is not symmetric and positive definite";
    case ERRORS_BAD_BOUNDS:
        return "a lower bound is not below the upper one";
    case ERRORS_BAD_START:
        return "an unknown that stays above zero does not begin there";
    case ERRORS_NO_START:
        return "the data give no start: state one";
    case ERRORS_NOT_CONNECTED:
        return "no equation connects all unknowns, or they are more than 60: no case for consensus";
    case ERRORS_WORKSPACE_TOO_SMALL:
        return "the workspace is smaller than the size that was asked for";
    default:
        return "no status";
    }
}
