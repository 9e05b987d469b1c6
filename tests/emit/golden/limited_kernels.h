/* limited: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

/*
 * d: what should be zero in each row.
 *
 *     0 = ((a*x + b) + q*(x*x)) - y
 */
static void d_values(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double q = inputs[2];
    const double x = inputs[3];
    const double y = inputs[4];

    outputs[0] = a * x + b + q * kernel_square(x) - y;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(a, coordinate 1)
 *     d(component 1) / d(b, coordinate 1)
 *     d(component 1) / d(q, coordinate 1)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double q = inputs[2];
    const double x = inputs[3];
    const double y = inputs[4];
    const double t1 = kernel_square(x);

    outputs[0] = a * x + b + q * t1 - y;
    outputs[1] = x;
    outputs[2] = 1.0;
    outputs[3] = t1;
}

/*
 * prior_q: what should be zero in each row.
 *
 *     0 = q
 */
static void prior_q_values(const double *inputs, double *outputs)
{
    const double q = inputs[0];

    outputs[0] = q;
}

/*
 * prior_q: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(q, coordinate 1)
 */
static void prior_q_slopes(const double *inputs, double *outputs)
{
    const double q = inputs[0];

    outputs[0] = q;
    outputs[1] = 1.0;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.2;
}

/* prior_q: stated noise. */
static void prior_q_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
}

/* a: where the iteration begins. */
static void start_of_a(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
}

/* b: where the iteration begins. */
static void start_of_b(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
}

/* q: where the iteration begins. */
static void start_of_q(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.0;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 5, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 5, outputs + row * 4);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            prior_q_values(inputs + row * 1, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            prior_q_slopes(inputs + row * 1, outputs + row * 2);
        break;
    default:
        break;
    }
}

