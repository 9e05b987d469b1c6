/* derived: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_less_equal(double a, double b) { return a <= b ? 1.0 : 0.0; }
static double kernel_equal(double a, double b) { return a == b ? 1.0 : 0.0; }

/*
 * steps: what should be zero in each row.
 *
 *     0 = (h[to] - h[from]) - rise
 */
static void steps_values(const double *inputs, double *outputs)
{
    const double h_to = inputs[0];  /* h[to] */
    const double h_from = inputs[1];  /* h[from] */
    const double rise = inputs[2];

    outputs[0] = h_to - h_from - rise;
}

/*
 * steps: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(h[to], coordinate 1)
 *     d(component 1) / d(h[from], coordinate 1)
 */
static void steps_slopes(const double *inputs, double *outputs)
{
    const double h_to = inputs[0];  /* h[to] */
    const double h_from = inputs[1];  /* h[from] */
    const double rise = inputs[2];

    outputs[0] = h_to - h_from - rise;
    outputs[1] = 1.0;
    outputs[2] = -1.0;
}

/*
 * climb, and behind it its derivatives that are not zero everywhere.
 *
 *     climb = h[to] - h[from]
 */
static void climb_derived(const double *inputs, double *outputs)
{
    const double h_to = inputs[0];  /* h[to] */
    const double h_from = inputs[1];  /* h[from] */

    outputs[0] = h_to - h_from;
    outputs[1] = 1.0;
    outputs[2] = -1.0;
}

/*
 * top, and behind it its derivatives that are not zero everywhere.
 *
 *     top = Max(h["b"], h["c"])
 */
static void top_derived(const double *inputs, double *outputs)
{
    const double h_b = inputs[0];  /* h["b"] */
    const double h_c = inputs[1];  /* h["c"] */
    const double t1 = kernel_less_equal(h_c, h_b);
    const double t2 = kernel_less_equal(h_b, h_c);
    const double t3 = t1 + t2;

    outputs[0] = fmax(h_b, h_c);
    outputs[1] = t1 / t3;
    outputs[2] = t2 / t3;
}

/*
 * both, and behind it its derivatives that are not zero everywhere.
 *
 *     both = h["b"]
 *     both = 2*h["c"]
 */
static void both_derived(const double *inputs, double *outputs)
{
    const double h_b = inputs[0];  /* h["b"] */
    const double h_c = inputs[1];  /* h["c"] */

    outputs[0] = h_b;
    outputs[1] = 2.0 * h_c;
    outputs[2] = 1.0;
    outputs[3] = 2.0;
}

/* steps: stated noise. */
static void steps_noise(const double *inputs, double *outputs)
{
    const double s = inputs[0];

    outputs[0] = s * 0.01;
}

/* h: where the iteration begins. */
static void start_of_h(const double *inputs, double *outputs)
{
    const double height = inputs[0];

    outputs[0] = height;
}

/* h: which coordinates stay: 1 or 0. */
static void fixed_of_h(const double *inputs, double *outputs)
{
    const double known = inputs[0];

    outputs[0] = kernel_equal(known, 1.0);
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            steps_values(inputs + row * 3, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            steps_slopes(inputs + row * 3, outputs + row * 3);
        break;
    default:
        break;
    }
}

