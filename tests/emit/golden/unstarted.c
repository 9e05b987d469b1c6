/* unstarted: from tables to the arrays of the solver, and back. */

#include "unstarted.h"

#include <stddef.h>
#include <string.h>

#include "unstarted_kernels.h"
#include "unstarted_solver.h"

/* How the solver's description of the equations begins: what no data change. */
static const long SYSTEM[52] = {
    0, 0, 0, 1, 0, 0, 0, 0, 100, 0, 0, 0, 0, 32, 0, 0, 0, 24, 0, 0, 0, 0, 0, 0, 0, 1, 1, 2, 3, 2, 2, 0, 0, 1,
    1, 16, 22, -1, 28, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0
};

/* Of each unknown: numbers, coordinates, family, positive, pieces. */
static const long UNKNOWNS[12] = {
    2, 2, 0, 0, 2, 6, 0, 0, 0, 0, 1, 1
};

/* Parameter and shape of each loss. */
static const double LOSSES[1] = {
    0.0
};

/* What consensus (lmeds) is asked for, without room for rows. */
static const long RULES[26] = {
    0, 1, 1361133826, 697191286, 1, 21, 5, 1, 0, 421, 16, 19, 0, 0, 0, 0, 100, 100, 100, 0, 0, 2, 0, 0, 0, 1
};

/* Of each kind of unit: median, limit and reach of its squared norm. */
static const double LEVELS[4] = {
    0.454936423119572, 6.25, 9.0, 0.0
};

/* Of each kind of unit: where its map begins, -1: it has none. */
static const long MAP_PLACES[1] = {
    0
};

/* From the data of a row to what the closed form for subsets wants. */
static const double MAPS[20] = {
    1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
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
    const unstarted_data *data;
    long members[1];        /* of each unknown; 1 without a family */
    long offsets[2];        /* where the numbers of each unknown begin */
    long firsts[2];         /* where its coordinates begin */
    long data_numbers[6];      /* of `data_set` */
    long *masts_of_ranges;    /* the row of `masts` that each row names */
    long *chosen, *fixed, *used, *column, *index, *columns, *sides, *coordinates;
    struct problem *system;
    struct work work;
    struct data_set *data_set;    /* as the solver wants it */
    long parameters_used, weights_used, index_used, columns_used;
    double *parameters, *weights, *scratch, *start, *lower, *upper, *constants, *point, *sigma;
    double *triangle, *covariance, *multipliers, *spare;
    long *rules, *places;    /* of consensus: what is asked for, scratch */
    struct problem *wide;    /* the equations with all rows side by side */
    double *desk, *bench, *known;    /* scratch, and what the closed form knows of the units */
    long agreement[4], units;
    int startless;
    double kappa[1];    /* of each kind of unit: what limits leave */
    double results[8];
    long states[8];
};

/* Lays out a frame for the rows of `data`: the most that can be needed. */
static void lay_out(struct frame *f, const unstarted_data *data, struct arena *a)
{
    long n, numbers, residuals = 4, inputs = 0, weights = 0, multipliers = 0, i;
    long parameters = 0, index = 0, columns = 0, chosen = 1;
    struct problem header = {0};

    f->data = data;
    f->masts_of_ranges = integers_of(a, data->ranges_rows);
    f->members[0] = 1;
    place_unknowns(UNKNOWNS, 1, f->members, f->offsets, f->firsts);
    numbers = f->offsets[1];
    n = f->firsts[1];
    /* ranges */
    chosen = chosen < data->ranges_rows ? data->ranges_rows : chosen;
    parameters += data->ranges_rows * 3;
    residuals += data->ranges_rows * 1;
    inputs += data->ranges_rows * 5;
    index += (data->ranges_rows + 1) * 2;
    columns += (data->ranges_rows + 1) * 2;
    weights += data->ranges_rows * 1;
    f->chosen = integers_of(a, chosen + 1);
    f->index = integers_of(a, index + 1);
    f->columns = integers_of(a, columns + 1);
    f->fixed = integers_of(a, n + 1);
    f->used = integers_of(a, n + 1);
    f->column = integers_of(a, n + 1);
    f->sides = integers_of(a, n + 1);
    f->coordinates = integers_of(a, n + 1);
    f->system = (struct problem *)integers_of(a, 52 + (2 + 8) * n);
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
    {    /* consensus: all rows side by side */
        long room[16] = {0, 1, 1361133826, 697191286, 1, 21, 5, 1, 0, 421, 16, 19, 0, 0, 0, 0};
        long units = 1, rows = 1;
        header.residual_blocks = 1;
        header.constraint_blocks = 0;
        if (header.chunk < residuals)
            header.chunk = (residuals + 3) / 4 * 4;
        if (header.most_outputs < 3 * (header.chunk / 1 + 1))
            header.most_outputs = 3 * (header.chunk / 1 + 1);
        units += data->ranges_rows * 1;
        rows += (n + 1) * 3;
        room[8] = units;
        room[13] = rows;
        f->rules = integers_of(a, 26);
        f->wide = (struct problem *)integers_of(a, 52 + (2 + 8) * n);
        f->places = integers_of(a, places_integers(&header, room));
        f->bench = reals_of(a, bench_reals(&header, room));
        f->desk = reals_of(a, rows_reals(&header));
        f->known = reals_of(a, units * 5);
    }
    f->work.reals = reals_of(a, work_reals(&header));
    f->spare = reals_of(a, 12 + 2 * n);
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
    const unstarted_data *data = f->data;
    long row, last;

    (void)data;
    /* the row of `masts` that each row of `ranges` names */
    last = -1;
    for (row = 0; row < data->ranges_rows; row++) {
        last = place_of_text(data->ranges_mast[row], data->masts_id, NULL, data->masts_rows, last);
        if (last < 0)
            return UNSTARTED_UNKNOWN_KEY;
        f->masts_of_ranges[row] = last;
    }
    return 0;
}

/* `p`. */
static int set_up_p(struct frame *f)
{
    const unstarted_data *data = f->data;
    double stated[2];
    double lower[2], upper[2];
    long m, c;

    (void)stated;
    for (m = 0; m < f->members[0]; m++) {
        const long number = f->offsets[0] + m * 2;
        const long first = f->firsts[0] + m * 2;
        for (c = 0; c < 2; c++) {
            lower[c] = -HUGE_VAL;
            upper[c] = HUGE_VAL;
        }
        for (c = 0; c < 2; c++) {
            if (!(lower[c] < upper[c]))
                return UNSTARTED_BAD_BOUNDS;
            f->lower[first + c] = lower[c];
            f->upper[first + c] = upper[c];
            f->fixed[first + c] = 0;
        }
        if (data->start_p != NULL) {
            for (c = 0; c < 2; c++)
                f->start[number + c] = data->start_p[m * 2 + c];
            continue;
        }
        f->start[number + 0] = 0.995298041036697;
        f->start[number + 1] = 1.9732512086060745;
    }
    return 0;
}

/* Starts, bounds and what stays, of all unknowns. */
static int set_up(struct frame *f)
{
    int status = 0;

    if (status == 0)
        status = set_up_p(f);
    return status;
}

/* The rows of `ranges` that ranges is about. */
static int ranges_rows(struct frame *f, long *count)
{
    const unstarted_data *data = f->data;
    long row;

    (void)data;
    *count = 0;
    for (row = 0; row < data->ranges_rows; row++) {
        f->chosen[(*count)++] = row;
    }
    return 0;
}

/* Parameters, weights and unknowns of the rows of ranges: kernel 0. */
static int ranges_assemble(struct frame *f, long count)
{
    const unstarted_data *data = f->data;
    double inputs[1], noise[1];
    struct data_block *own = &blocks_of_data_set(f->data_set)[0];
    long i, rows = 0;

    (void)data;
    inputs[0] = 0.0;
    own->parameters = f->parameters_used;
    own->weights = f->weights_used;
    own->index = f->index_used;
    own->columns = f->columns_used;
    for (i = 0; i < count; i++) {
        const long row = f->chosen[i];
        f->parameters[f->parameters_used++] = data->masts_x[f->masts_of_ranges[row]];
        f->parameters[f->parameters_used++] = data->masts_y[f->masts_of_ranges[row]];
        f->parameters[f->parameters_used++] = data->ranges_r[row];
        ranges_noise(inputs, noise);
        if (!weight_of_sigma(noise[0], f->weights + f->weights_used + 0))
            return -1;
        f->weights_used += 1;
        if (rows == 0) {    /* all rows share their unknowns */
            f->index[f->index_used++] = f->offsets[0];    /* p */
            f->index[f->index_used++] = f->offsets[0] + 1;    /* p */
            f->columns[f->columns_used++] = f->firsts[0];    /* p */
            f->columns[f->columns_used++] = f->firsts[0] + 1;    /* p */
        }
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

    /* observation ranges */
    status = ranges_rows(f, &count);
    if (status != 0)
        return status;
    all = 0;
    rows = ranges_assemble(f, count);
    if (rows < 0)
        return UNSTARTED_BAD_NOISE;
    all += rows;
    if (all != count)
        return UNSTARTED_UNKNOWN_CASE;
    return status;
}


/* Everything of a data set that the solver is handed. */
static int prepare(struct frame *f, const unstarted_data *data,
    unstarted_workspace *workspace)
{
    struct arena a = {0};
    long b, c, count;
    int status;

    lay_out(f, data, &a);
    if (a.reals_used > workspace->reals_size || a.integers_used > workspace->integers_size)
        return UNSTARTED_WORKSPACE_TOO_SMALL;
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
    for (c = 0; c < 52; c++)
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
    set_coordinates((long *)f->system, 52, c, UNKNOWNS, 1, f->members, f->offsets,
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
    for (b = 0; b < 1; b++)
        f->kappa[b] = 1.0;
    for (b = 0; b < 26; b++)
        f->rules[b] = RULES[b];
    for (b = 0; b < 4; b++)
        f->agreement[b] = 0;
    f->units = 0;
    f->startless = data->start_p == NULL;
    return 0;
}

/* Consensus: where the solve begins, and which rows count. */
static int agree_on(struct frame *f, double *factors)
{
    long scalars;

    if (!f->startless)
        return 0;
    if (f->system->n > 1
        && !connected(f->system, f->data_set, f->columns, f->places))
        return UNSTARTED_NOT_CONNECTED;
    scalars = set_room(f->system, f->data_set, f->rules);
    side_by_side((long *)f->system, 52 + (2 + 8) * f->system->n, (long *)f->wide);
    f->rules[14] = f->startless;
    known_units(f->system, f->data_set, f->rules, MAP_PLACES, MAPS,
        1.0, f->parameters, f->known);
    f->units = come_to_agreement(0, scalars, f->system, f->wide, f->constants,
        f->data_set, f->parameters, f->weights, f->index, f->columns, f->rules, LEVELS, f->known,
        f->start, f->work.rows, f->desk, f->bench, f->places, f->agreement, f->kappa, factors);
    if (f->startless && f->agreement[0] == 0)
        return UNSTARTED_NO_START;
    return 0;
}

/* Where the answer stands; `sigma` of what is not determined is negative, of what stays 0. */
static void answer(struct frame *f, unstarted_result *result)
{
    const long n = f->system->n, all = f->firsts[1];
    long c;

    if (f->states[4] != 0)
        mask_undetermined(f->system, &f->work, f->covariance);
    for (c = 0; c < all; c++)
        f->sigma[c] = f->fixed[c] ? 0.0 : -1.0;
    for (c = 0; c < n; c++) {
        const double variance = f->covariance[c * n + c];
        f->sigma[f->coordinates[c]] = variance >= 0.0 ? sqrt(variance) : -1.0;
    }
    result->numbers = f->offsets[1];
    result->point = f->point;
    result->free = n;
    result->coordinates = f->coordinates;
    result->covariance = f->covariance;
    result->sigmas = f->sigma;
    result->p = f->point + f->offsets[0];
    result->p_sigma = f->sigma + f->firsts[0];
}

/* What the reason of the solver means to the caller. */
static int status_of(const struct frame *f)
{
    const long reason = f->states[0];

    if (reason == 7)
        return UNSTARTED_NOT_FINITE;
    if (reason == 9)
        return UNSTARTED_INFEASIBLE;
    if (f->states[4] != 0)
        return UNSTARTED_UNOBSERVABLE;
    if (reason < 1 || reason > 4)
        return UNSTARTED_NOT_CONVERGED;
    return UNSTARTED_CONVERGED;
}

void unstarted_workspace_size(const unstarted_data *data, unstarted_workspace *workspace)
{
    struct frame f;
    struct arena a = {0};

    lay_out(&f, data, &a);
    workspace->reals_size = a.reals_used;
    workspace->integers_size = a.integers_used;
}

int unstarted_solve(const unstarted_data *data, unstarted_result *result, unstarted_workspace *workspace)
{
    struct frame frame, *f = &frame;
    double factors[1];
    long c, n;
    double scatter;

    result->status = prepare(f, data, workspace);
    if (result->status != 0)
        return result->status;
    n = f->system->n;
    for (c = 0; c < 1; c++)
        factors[c] = 1.0;
    result->status = agree_on(f, factors);
    if (result->status != 0)
        return result->status;
    solve_noises(f->system, f->constants, f->parameters, f->weights, f->index, f->columns, f->data_set,
        f->start, &f->work, f->point, f->results, f->states, f->sides, f->triangle, f->covariance,
        f->multipliers, f->kappa, factors, f->spare);
    result->cost = f->results[2];
    /* all residuals share one unknown factor: the noise is as large as the residuals say */
    scatter = spread_of_group(f->system, f->data_set, f->parameters, f->weights, f->index, f->columns, f->point,
        f->covariance, f->kappa, -1, 0, f->spare);
    result->status = status_of(f);
    result->iterations = f->states[1];
    result->evaluations = f->states[2];
    result->robust_cost = f->results[0];
    result->freedom = f->states[3];
    result->sigma0 = result->freedom > 0 ? sqrt(result->cost / (double)result->freedom) : 0.0;
    for (c = 0; c < n * n; c++)
        f->covariance[c] *= result->freedom > 0 ? scatter / (double)result->freedom : 0.0;
    if (result->freedom <= 0)
        undetermined(n, f->sides, f->covariance);
    answer(f, result);
    return result->status;
}

int unstarted_begin(const unstarted_data *data, unstarted_result *result, unstarted_workspace *workspace)
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

long unstarted_residual_count(const unstarted_data *data, unstarted_workspace *workspace)
{
    struct frame f;

    return prepare(&f, data, workspace) == 0 ? f.data_set->count : 0;
}

void unstarted_residuals(const unstarted_data *data, const double *point, double *residuals,
    unstarted_workspace *workspace)
{
    struct frame frame, *f = &frame;

    if (prepare(f, data, workspace) != 0)
        return;
    all_rows(f->system, f->data_set, f->parameters, f->weights, f->index, f->columns, point, 0,
        f->spare, f->spare + row_scratch(f->system), residuals);
}

void unstarted_jacobian(const unstarted_data *data, const double *point, double *jacobian,
    unstarted_workspace *workspace)
{
    struct frame frame, *f = &frame;

    if (prepare(f, data, workspace) != 0)
        return;
    all_rows(f->system, f->data_set, f->parameters, f->weights, f->index, f->columns, point, 1,
        f->spare, f->spare + row_scratch(f->system), jacobian);
}

int unstarted_covariance(const unstarted_data *data, const double *point, double *covariance,
    unstarted_workspace *workspace)
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

const char *unstarted_status_text(int status)
{
    switch (status) {
    case UNSTARTED_CONVERGED:
        return "converged";
    case UNSTARTED_NOT_CONVERGED:
        return "not converged: the estimates should not be trusted";
    case UNSTARTED_UNOBSERVABLE:
        return "the data do not determine all unknowns";
    case UNSTARTED_INFEASIBLE:
        return "no point meets all constraints";
    case UNSTARTED_NO_AGREEMENT:
        return "fewer than half of the measurements agree with any one solution";
    case UNSTARTED_NOT_FINITE:
        return "an equation has no finite value at the start";
    case UNSTARTED_NO_ROWS:
        return "a table that one row is wanted of has none";
    case UNSTARTED_UNKNOWN_KEY:
        return "a key names no row or member";
    case UNSTARTED_UNKNOWN_CASE:
        return "a row has values that no row had when the solver was made";
    case UNSTARTED_BAD_NOISE:
        return "a standard deviation is not above zero, or a matrix is not symmetric and positive definite";
    case UNSTARTED_BAD_BOUNDS:
        return "a lower bound is not below the upper one";
    case UNSTARTED_BAD_START:
        return "an unknown that stays above zero does not begin there";
    case UNSTARTED_NO_START:
        return "the data give no start: state one";
    case UNSTARTED_NOT_CONNECTED:
        return "no equation connects all unknowns, or they are more than 60: no case for consensus";
    case UNSTARTED_WORKSPACE_TOO_SMALL:
        return "the workspace is smaller than the size that was asked for";
    default:
        return "no status";
    }
}
