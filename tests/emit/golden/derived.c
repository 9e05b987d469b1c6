/* derived: from tables to the arrays of the solver, and back. */

#include "derived.h"

#include <stddef.h>
#include <string.h>

#include "derived_kernels.h"
#include "derived_solver.h"

/* How the solver's description of the equations begins: what no data change. */
static const long SYSTEM[57] = {
    0, 0, 0, 1, 0, 0, 1, 1, 0, 100, 0, 0, 0, 0, 0, 0, 0, 32, 0, 0, 0, 29, 0, 1, 0, 0, 0, 0, 0, 0, 1, 1, 2, 1,
    2, 2, 2, 2, 1, 1, 16, 22, -1, 28, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0
};

/* Of each unknown: numbers, coordinates, family, positive, pieces. */
static const long UNKNOWNS[9] = {
    1, 1, 1, 0, 1, 6, 0, 0, 0
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
    const derived_data *data;
    long members[1];        /* of each unknown; 1 without a family */
    long offsets[2];        /* where the numbers of each unknown begin */
    long firsts[2];         /* where its coordinates begin */
    long data_numbers[6];      /* of `data_set` */
    long *h_of_steps;    /* the member that each row names */
    long *h_of_steps_;    /* the member that each row names */
    long *h_b;    /* the member that each row names */
    long *h_c;    /* the member that each row names */
    long *marks_members;    /* a row of `marks` for each member */
    long marks_members_count;
    long *chosen, *fixed, *used, *column, *index, *columns, *sides, *coordinates;
    struct problem *system;
    struct work work;
    struct data_set *data_set;    /* as the solver wants it */
    long parameters_used, weights_used, index_used, columns_used;
    double *parameters, *weights, *scratch, *start, *lower, *upper, *constants, *point, *sigma;
    double *triangle, *covariance, *multipliers, *spare;
    double *derived_climb, *derived_climb_sigma;
    long derived_climb_count;
    double *derived_top, *derived_top_sigma;
    long derived_top_count;
    double *derived_both, *derived_both_sigma;
    long derived_both_count;
    double kappa[2];    /* by kind of unit: κ, its worth */
    double results[8];
    long states[8];
};

/* Lays out a frame for the rows of `data`: the most that can be needed. */
static void lay_out(struct frame *f, const derived_data *data, struct arena *a)
{
    long n, numbers, residuals = 4, inputs = 0, weights = 0, multipliers = 0, i;
    long parameters = 0, index = 0, columns = 0, chosen = 1;
    struct problem header = {0};

    f->data = data;
    f->h_of_steps = integers_of(a, data->steps_rows);
    f->h_of_steps_ = integers_of(a, data->steps_rows);
    f->h_b = integers_of(a, 1);
    f->h_c = integers_of(a, 1);
    f->marks_members = integers_of(a, data->marks_rows);
    f->members[0] = data->marks_rows;
    place_unknowns(UNKNOWNS, 1, f->members, f->offsets, f->firsts);
    numbers = f->offsets[1];
    n = f->firsts[1];
    /* steps */
    chosen = chosen < data->steps_rows ? data->steps_rows : chosen;
    parameters += data->steps_rows * 1;
    residuals += data->steps_rows * 1;
    inputs += data->steps_rows * 3;
    index += (data->steps_rows + 1) * 2;
    columns += (data->steps_rows + 1) * 2;
    weights += data->steps_rows * 1;
    f->chosen = integers_of(a, chosen + 1);
    f->index = integers_of(a, index + 1);
    f->columns = integers_of(a, columns + 1);
    f->fixed = integers_of(a, n + 1);
    f->used = integers_of(a, n + 1);
    f->column = integers_of(a, n + 1);
    f->sides = integers_of(a, n + 1);
    f->coordinates = integers_of(a, n + 1);
    f->system = (struct problem *)integers_of(a, 57 + (2 + 8) * n);
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
    header.most_outputs = 96;
    f->work.reals = reals_of(a, work_reals(&header));
    f->spare = reals_of(a, 12 + 2 * n);
    f->derived_climb = reals_of(a, 1 * data->steps_rows + 1);
    f->derived_climb_sigma = reals_of(a, 1 * data->steps_rows + 1);
    f->derived_top = reals_of(a, 1 + 1);
    f->derived_top_sigma = reals_of(a, 1 + 1);
    f->derived_both = reals_of(a, 2 + 1);
    f->derived_both_sigma = reals_of(a, 2 + 1);
    f->work.integers = integers_of(a, work_integers(&header));
    f->parameters_used = f->weights_used = f->index_used = f->columns_used = 0;
    for (i = 0; i < 6; i++)
        f->data_numbers[i] = 0;
    f->data_set = (struct data_set *)f->data_numbers;
}

/* The place of a key among cells: those in `rows`, or the first `count`; -1: it is none. Data often come
 * in the order of their keys, so the search begins behind the place that was found last, and goes round. */
static long place_of_text(const char *key, const char *const *cells, const long *rows, long count, long last)
{
    long i;
    for (i = 0; i < count; i++) {
        const long place = (last + 1 + i) % count;
        if (strcmp(cells[rows != NULL ? rows[place] : place], key) == 0)
            return place;
    }
    return -1;
}

/* The rows that count, the members of families, and what the keys name. */
static int find_rows(struct frame *f)
{
    const derived_data *data = f->data;
    long row, last;

    (void)data;
    /* the members: rows of `marks` */
    f->marks_members_count = 0;
    for (row = 0; row < data->marks_rows; row++) {
        f->marks_members[f->marks_members_count++] = row;
    }
    f->members[0] = f->marks_members_count;    /* h */
    /* the member that each row of `steps` names */
    last = -1;
    for (row = 0; row < data->steps_rows; row++) {
        last = place_of_text(data->steps_to[row], data->marks_id, f->marks_members, f->marks_members_count, last);
        if (last < 0)
            return DERIVED_UNKNOWN_KEY;
        f->h_of_steps[row] = last;
    }
    /* the member that each row of `steps` names */
    last = -1;
    for (row = 0; row < data->steps_rows; row++) {
        last = place_of_text(data->steps_from_[row], data->marks_id, f->marks_members, f->marks_members_count, last);
        if (last < 0)
            return DERIVED_UNKNOWN_KEY;
        f->h_of_steps_[row] = last;
    }
    /* the member that the problem names */
    f->h_b[0] = place_of_text("b", data->marks_id, f->marks_members, f->marks_members_count, -1);
    if (f->h_b[0] < 0)
        return DERIVED_UNKNOWN_KEY;
    /* the member that the problem names */
    f->h_c[0] = place_of_text("c", data->marks_id, f->marks_members, f->marks_members_count, -1);
    if (f->h_c[0] < 0)
        return DERIVED_UNKNOWN_KEY;
    return 0;
}

/* `h`. */
static int set_up_h(struct frame *f)
{
    const derived_data *data = f->data;
    double inputs[1];
    double stated[1];
    double lower[1], upper[1];
    double fixed[1];
    long m, c;

    (void)stated;
    for (m = 0; m < f->members[0]; m++) {
        const long row = f->marks_members[m];
        const long number = f->offsets[0] + m * 1;
        const long first = f->firsts[0] + m * 1;
        (void)row;
        for (c = 0; c < 1; c++) {
            lower[c] = -HUGE_VAL;
            upper[c] = HUGE_VAL;
        }
        inputs[0] = data->marks_known[row];
        fixed_of_h(inputs, fixed);
        for (c = 0; c < 1; c++) {
            if (!(lower[c] < upper[c]))
                return DERIVED_BAD_BOUNDS;
            f->lower[first + c] = lower[c];
            f->upper[first + c] = upper[c];
            f->fixed[first + c] = fixed[c] == 1.0;
        }
        if (data->start_h != NULL) {
            for (c = 0; c < 1; c++)
                f->start[number + c] = data->start_h[m * 1 + c];
            continue;
        }
        inputs[0] = data->marks_height[row];
        start_of_h(inputs, stated);
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
        status = set_up_h(f);
    return status;
}

/* The rows of `steps` that steps is about. */
static int steps_rows(struct frame *f, long *count)
{
    const derived_data *data = f->data;
    long row;

    (void)data;
    *count = 0;
    for (row = 0; row < data->steps_rows; row++) {
        f->chosen[(*count)++] = row;
    }
    return 0;
}

/* Parameters, weights and unknowns of the rows of steps: kernel 0. */
static int steps_assemble(struct frame *f, long count)
{
    const derived_data *data = f->data;
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
        f->parameters[f->parameters_used++] = data->steps_rise[row];
        inputs[0] = data->steps_s[row];
        steps_noise(inputs, noise);
        if (!weight_of_sigma(noise[0], f->weights + f->weights_used + 0))
            return -1;
        f->weights_used += 1;
        f->index[f->index_used++] = f->offsets[0] + f->h_of_steps[row] * 1;    /* h */
        f->index[f->index_used++] = f->offsets[0] + f->h_of_steps_[row] * 1;    /* h */
        f->columns[f->columns_used++] = f->firsts[0] + f->h_of_steps[row] * 1;    /* h */
        f->columns[f->columns_used++] = f->firsts[0] + f->h_of_steps_[row] * 1;    /* h */
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

    /* observation steps */
    status = steps_rows(f, &count);
    if (status != 0)
        return status;
    all = 0;
    rows = steps_assemble(f, count);
    if (rows < 0)
        return DERIVED_BAD_NOISE;
    all += rows;
    if (all != count)
        return DERIVED_UNKNOWN_CASE;
    return status;
}

/* The column of the coordinate at a place: -1: it stays, -2: the data do not determine it. */
static long column_of(const struct frame *f, long place)
{
    return f->column[place] >= 0 || f->fixed[place] ? f->column[place] : -2;
}

/* The standard deviation of quantity `row` of those with the derivatives `slopes`, by linear propagation; negative
 * where the data do not determine it, only limits hold it, or it has no derivative at the estimates. */
static double spread_of(struct frame *f, long row, long count, const long *rows, const long *tangents,
    const long *columns, const double *slopes, double *gradient)
{
    const long n = f->system->n;
    double variance = 0.0;
    long i, j;

    if (!gather_gradient(n, row, count, rows, tangents, columns, slopes, gradient))
        return -1.0;
    if (f->states[4] != 0 && !determines(f->system, gradient, &f->work))
        return -1.0;
    for (i = 0; i < n; i++) {
        if (gradient[i] == 0.0)
            continue;
        if (!(f->covariance[i * n + i] >= 0.0))
            return -1.0;
        for (j = 0; j < n; j++)
            if (gradient[j] != 0.0)
                variance += gradient[i] * f->covariance[i * n + j] * gradient[j];
    }
    if (!isfinite(variance) || held_by_limits(f->system, &f->work, gradient, row, count, rows, tangents, columns))
        return -1.0;
    return variance > 0.0 ? sqrt(variance) : 0.0;
}

/* climb, for each row of `steps`. */
static int derive_climb(struct frame *f)
{
    const derived_data *data = f->data;
    static const long rows_1[] = {0, 0};
    static const long tangents_1[] = {0, 1};
    double inputs[3], outputs[4];
    long columns[3], c;
    long row, used = 0;

    (void)data;
    for (row = 0; row < data->steps_rows; row++) {
        {
            inputs[0] = f->point[f->offsets[0] + f->h_of_steps[row] * 1];
            inputs[1] = f->point[f->offsets[0] + f->h_of_steps_[row] * 1];
            columns[0] = column_of(f, f->firsts[0] + f->h_of_steps[row] * 1);
            columns[1] = column_of(f, f->firsts[0] + f->h_of_steps_[row] * 1);
            climb_derived(inputs, outputs);
            for (c = 0; c < 1; c++) {
                f->derived_climb[used * 1 + c] = outputs[c];
                f->derived_climb_sigma[used * 1 + c] = spread_of(f, c, 2, rows_1, tangents_1, columns, outputs + 1, f->spare);
            }
            used++;
        }
    }
    f->derived_climb_count = used;
    return 1;
}

/* top, once. */
static int derive_top(struct frame *f)
{
    const derived_data *data = f->data;
    static const long rows_1[] = {0, 0};
    static const long tangents_1[] = {0, 1};
    double inputs[3], outputs[4];
    long columns[3], c;
    long used = 0;

    (void)data;
    {
        const long row = 0;
        {
            inputs[0] = f->point[f->offsets[0] + f->h_b[0] * 1];
            inputs[1] = f->point[f->offsets[0] + f->h_c[0] * 1];
            columns[0] = column_of(f, f->firsts[0] + f->h_b[0] * 1);
            columns[1] = column_of(f, f->firsts[0] + f->h_c[0] * 1);
            top_derived(inputs, outputs);
            for (c = 0; c < 1; c++) {
                f->derived_top[used * 1 + c] = outputs[c];
                f->derived_top_sigma[used * 1 + c] = spread_of(f, c, 2, rows_1, tangents_1, columns, outputs + 1, f->spare);
            }
            used++;
        }
        (void)row;
    }
    f->derived_top_count = used;
    return 1;
}

/* both, once. */
static int derive_both(struct frame *f)
{
    const derived_data *data = f->data;
    static const long rows_1[] = {0, 1};
    static const long tangents_1[] = {0, 1};
    double inputs[3], outputs[5];
    long columns[3], c;
    long used = 0;

    (void)data;
    {
        const long row = 0;
        {
            inputs[0] = f->point[f->offsets[0] + f->h_b[0] * 1];
            inputs[1] = f->point[f->offsets[0] + f->h_c[0] * 1];
            columns[0] = column_of(f, f->firsts[0] + f->h_b[0] * 1);
            columns[1] = column_of(f, f->firsts[0] + f->h_c[0] * 1);
            both_derived(inputs, outputs);
            for (c = 0; c < 2; c++) {
                f->derived_both[used * 2 + c] = outputs[c];
                f->derived_both_sigma[used * 2 + c] = spread_of(f, c, 2, rows_1, tangents_1, columns, outputs + 2, f->spare);
            }
            used++;
        }
        (void)row;
    }
    f->derived_both_count = used;
    return 1;
}

/* Everything of a data set that the solver is handed. */
static int prepare(struct frame *f, const derived_data *data,
    derived_workspace *workspace)
{
    struct arena a = {0};
    long b, c, count;
    int status;

    lay_out(f, data, &a);
    if (a.reals_used > workspace->reals_size || a.integers_used > workspace->integers_size)
        return DERIVED_WORKSPACE_TOO_SMALL;
    a.reals = workspace->reals;
    a.integers = workspace->integers;
    a.reals_used = a.integers_used = 0;
    lay_out(f, data, &a);
    status = find_rows(f);
    if (status != 0)
        return status;
    place_unknowns(UNKNOWNS, 1, f->members, f->offsets, f->firsts);
    status = set_up(f);
    if (status == 0)
        status = assemble(f);
    if (status != 0)
        return status;
    for (c = 0; c < 57; c++)
        ((long *)f->system)[c] = SYSTEM[c];
    count = f->firsts[1];
    for (c = 0; c < count; c++)
        f->used[c] = 0;
    for (b = 0; b < 1; b++) {
        const struct data_block *own = &blocks_of_data_set(f->data_set)[b];
        mark_used(&blocks_of_problem(f->system)[b], own->rows, f->columns + own->columns, f->used);
    }
    c = free_coordinates(UNKNOWNS, 1, f->members, f->firsts, f->used, f->fixed, f->column);
    renumber(f->columns_used, f->column, f->columns);
    f->system->n = c;
    set_coordinates((long *)f->system, 57, UNKNOWNS, 1, f->members, f->offsets,
        f->firsts, f->column);
    f->data_set->count = set_capacities(f->system, f->data_set);
    set_constants(f->system, f->constants, count, f->column, f->lower, f->upper, TOLERANCE, LOSSES);
    share_out(f->system, &f->work);
    f->work.rows.constants = f->constants;
    f->work.rows.data = f->data_set;
    f->work.rows.parameters = f->parameters;
    f->work.rows.whitening = f->weights;
    f->work.rows.index = f->index;
    f->work.rows.columns = f->columns;
    f->work.answer.numbers = f->point;
    f->work.answer.results = f->results;
    f->work.answer.states = f->states;
    f->work.answer.sides = f->sides;
    f->work.answer.triangle = f->triangle;
    f->work.answer.covariance = f->covariance;
    f->work.answer.multipliers = f->multipliers;
    for (b = 0; b < count; b++)
        if (f->column[b] >= 0)
            f->coordinates[f->column[b]] = b;
    for (b = 0; b < 2; b++)
        f->kappa[b] = 1.0;
    return 0;
}

/* Where the answer stands; `sigma` of what is not determined or at a bound is negative, of what stays 0. */
static void answer(struct frame *f, derived_result *result)
{
    const long n = f->system->n, all = f->firsts[1];
    long c;

    if (!derive_climb(f))
        result->status = DERIVED_UNKNOWN_CASE;
    result->climb = f->derived_climb;
    result->climb_sigma = f->derived_climb_sigma;
    result->climb_rows = f->derived_climb_count;
    if (!derive_top(f))
        result->status = DERIVED_UNKNOWN_CASE;
    result->top = f->derived_top;
    result->top_sigma = f->derived_top_sigma;
    if (!derive_both(f))
        result->status = DERIVED_UNKNOWN_CASE;
    result->both = f->derived_both;
    result->both_sigma = f->derived_both_sigma;
    if (f->states[4] != 0)
        mask_undetermined(f->system, &f->work, f->covariance);
    for (c = 0; c < all; c++)
        f->sigma[c] = f->fixed[c] ? 0.0 : -1.0;
    for (c = 0; c < n; c++) {
        const double variance = f->covariance[c * n + c];
        f->sigma[f->coordinates[c]] = variance >= 0.0 && f->sides[c] == 0 ? sqrt(variance) : -1.0;
    }
    result->numbers = f->offsets[1];
    result->point = f->point;
    result->free = n;
    result->coordinates = f->coordinates;
    result->covariance = f->covariance;
    result->sigmas = f->sigma;
    result->h_members = f->members[0];
    result->h_rows = f->marks_members;
    result->h = f->point + f->offsets[0];
    result->h_sigma = f->sigma + f->firsts[0];
}

/* What the reason of the solver means to the caller. */
static int status_of(const struct frame *f)
{
    const long reason = f->states[0];

    if (reason == 8)
        return DERIVED_NOT_FINITE;
    if (reason == 10)
        return DERIVED_INFEASIBLE;
    if (f->states[4] != 0)
        return DERIVED_UNOBSERVABLE;
    if (reason < 1 || reason > 5)
        return DERIVED_NOT_CONVERGED;
    return DERIVED_CONVERGED;
}

void derived_workspace_size(const derived_data *data, derived_workspace *workspace)
{
    struct frame f;
    struct arena a = {0};

    lay_out(&f, data, &a);
    workspace->reals_size = a.reals_used;
    workspace->integers_size = a.integers_used;
}

int derived_solve(const derived_data *data, derived_result *result, derived_workspace *workspace)
{
    struct frame frame, *f = &frame;

    result->settled = 1;
    result->status = prepare(f, data, workspace);
    if (result->status != 0)
        return result->status;
    solve_alone(f->system, f->data_set, f->start, &f->work);
    result->cost = f->results[2];
    result->status = status_of(f);
    result->iterations = f->states[1];
    result->evaluations = f->states[2];
    result->robust_cost = f->results[0];
    result->freedom = f->states[3];
    result->sigma0 = result->freedom > 0 ? sqrt(result->cost / (double)result->freedom) : 0.0;
    answer(f, result);
    return result->status;
}

int derived_begin(const derived_data *data, derived_result *result, derived_workspace *workspace)
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
    f->states[4] = f->work.penalised = 0;
    for (c = 0; c < n; c++)
        f->sides[c] = 0;
    answer(f, result);
    return result->status;
}

long derived_residual_count(const derived_data *data, derived_workspace *workspace)
{
    struct frame f;

    return prepare(&f, data, workspace) == 0 ? f.data_set->count : 0;
}

void derived_residuals(const derived_data *data, const double *point, double *residuals,
    derived_workspace *workspace)
{
    struct frame frame, *f = &frame;

    if (prepare(f, data, workspace) != 0)
        return;
    all_rows(f->system, &f->work.rows, point, 0,
        f->spare, f->spare + row_scratch(f->system), residuals);
}

void derived_jacobian(const derived_data *data, const double *point, double *jacobian,
    derived_workspace *workspace)
{
    struct frame frame, *f = &frame;

    if (prepare(f, data, workspace) != 0)
        return;
    all_rows(f->system, &f->work.rows, point, 1,
        f->spare, f->spare + row_scratch(f->system), jacobian);
}

int derived_covariance(const derived_data *data, const double *point, double *covariance,
    derived_workspace *workspace)
{
    struct frame frame, *f = &frame;
    long c;

    if (prepare(f, data, workspace) != 0)
        return 0;
    load_rows(f->system, &f->work.rows);
    sweep(f->system, point, 0, 0, &f->work.rows, f->constants, f->triangle);
    for (c = 0; c < f->system->n; c++)
        f->sides[c] = 0;
    c = set_covariance(f->system, f->triangle, f->sides, 0, f->constants, &f->work, covariance)
        < 1e300;
    mask_undetermined(f->system, &f->work, covariance);
    return (int)c;
}

const char *derived_status_text(int status)
{
    switch (status) {
    case DERIVED_CONVERGED:
        return "converged";
    case DERIVED_NOT_CONVERGED:
        return "not converged: the estimates should not be trusted";
    case DERIVED_UNOBSERVABLE:
        return "the data do not determine all unknowns";
    case DERIVED_INFEASIBLE:
        return "no point meets all constraints";
    case DERIVED_NO_AGREEMENT:
        return "fewer than half of the measurements agree with any one solution";
    case DERIVED_NOT_FINITE:
        return "an equation has no finite value at the start";
    case DERIVED_NO_ROWS:
        return "a table that one row is wanted of has none";
    case DERIVED_UNKNOWN_KEY:
        return "a key names no row or member";
    case DERIVED_UNKNOWN_CASE:
        return "a row has values that no row had when the solver was made";
    case DERIVED_BAD_NOISE:
        return "a standard deviation is not above zero, or a matrix is not symmetric and positive definite";
    case DERIVED_BAD_BOUNDS:
        return "a lower bound is not below the upper one";
    case DERIVED_BAD_START:
        return "an unknown that stays above zero does not begin there";
    case DERIVED_NO_START:
        return "the data give no start: state one";
    case DERIVED_NOT_CONNECTED:
        return "no equation connects all unknowns, or they are more than 60: no case for consensus";
    case DERIVED_WORKSPACE_TOO_SMALL:
        return "the workspace is smaller than the size that was asked for";
    default:
        return "no status";
    }
}
