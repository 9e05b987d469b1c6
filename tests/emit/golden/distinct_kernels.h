/* distinct: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_less(double a, double b) { return a < b ? 1.0 : 0.0; }
static double kernel_equal(double a, double b) { return a == b ? 1.0 : 0.0; }

/*
 * d: what should be zero in each row.
 *
 *     0 = (k*x + o[kind]) - y
 */
static void d_values(const double *inputs, double *outputs)
{
    const double k = inputs[0];
    const double o_kind = inputs[1];  /* o[kind] */
    const double x = inputs[2];
    const double y = inputs[3];

    outputs[0] = k * x + o_kind - y;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(k, coordinate 1)
 *     d(component 1) / d(o[kind], coordinate 1)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double k = inputs[0];
    const double o_kind = inputs[1];  /* o[kind] */
    const double x = inputs[2];
    const double y = inputs[3];

    outputs[0] = k * x + o_kind - y;
    outputs[1] = x;
    outputs[2] = 1.0;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
}

/* whether a row of `d` is kept: 1 or 0. */
static void d_kept(const double *inputs, double *outputs)
{
    const double good = inputs[0];

    outputs[0] = kernel_equal(good, 1.0);
}

/* k: where the iteration begins. */
static void start_of_k(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
}

/* o: where the iteration begins. */
static void start_of_o(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.0;
}

/* d: whether a row is used: 1 or 0. */
static void d_when(const double *inputs, double *outputs)
{
    const double x = inputs[0];

    outputs[0] = kernel_less(x, 10.0);
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 4, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 4, outputs + row * 3);
        break;
    default:
        break;
    }
}

