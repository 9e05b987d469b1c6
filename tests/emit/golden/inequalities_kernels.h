/* inequalities: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d: what should be zero in each row.
 *
 *     0 = (a*x + b) - y
 */
static void d_values(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double x = inputs[2];
    const double y = inputs[3];

    outputs[0] = a * x + b - y;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(a, coordinate 1)
 *     d(component 1) / d(b, coordinate 1)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double x = inputs[2];
    const double y = inputs[3];

    outputs[0] = a * x + b - y;
    outputs[1] = x;
    outputs[2] = 1.0;
}

/*
 * a_b_3: what should be zero in each row.
 *
 *     0 >= (a + b) - 1*3
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

/*
 * b_10: what should be zero in each row.
 *
 *     0 >= -10 - b
 */
static void b_10_values(const double *inputs, double *outputs)
{
    const double b = inputs[0];

    outputs[0] = -10.0 - b;
}

/*
 * b_10: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(b, coordinate 1)
 */
static void b_10_slopes(const double *inputs, double *outputs)
{
    const double b = inputs[0];

    outputs[0] = -10.0 - b;
    outputs[1] = -1.0;
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

    outputs[0] = 0.5;
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
    case 2:
        for (row = 0; row < rows; row++)
            a_b_3_values(inputs + row * 2, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            a_b_3_slopes(inputs + row * 2, outputs + row * 3);
        break;
    case 4:
        for (row = 0; row < rows; row++)
            b_10_values(inputs + row * 1, outputs + row * 1);
        break;
    case 5:
        for (row = 0; row < rows; row++)
            b_10_slopes(inputs + row * 1, outputs + row * 2);
        break;
    default:
        break;
    }
}

