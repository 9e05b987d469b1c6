/* held: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

/*
 * d: what should be zero in each row.
 *
 *     0 = ((a*x + b) + c*(x*x)) - y
 */
static void d_values(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double c = inputs[2];
    const double x = inputs[3];
    const double y = inputs[4];

    outputs[0] = a * x + b + c * kernel_square(x) - y;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(a, coordinate 1)
 *     d(component 1) / d(b, coordinate 1)
 *     d(component 1) / d(c, coordinate 1)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double c = inputs[2];
    const double x = inputs[3];
    const double y = inputs[4];
    const double t1 = kernel_square(x);

    outputs[0] = a * x + b + c * t1 - y;
    outputs[1] = x;
    outputs[2] = 1.0;
    outputs[3] = t1;
}

/*
 * a_b_3: what should be zero in each row.
 *
 *     0 = (a + b) - 1*3
 */
static void a_b_3_values(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];

    outputs[0] = a + b + -3.0;
}

/*
 * a_b_3: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(a, coordinate 1)
 *     d(component 1) / d(b, coordinate 1)
 */
static void a_b_3_slopes(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];

    outputs[0] = a + b + -3.0;
    outputs[1] = 1.0;
    outputs[2] = 1.0;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.2;
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

/* c: where the iteration begins. */
static void start_of_c(const double *inputs, double *outputs)
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
            a_b_3_values(inputs + row * 2, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            a_b_3_slopes(inputs + row * 2, outputs + row * 3);
        break;
    default:
        break;
    }
}

