/* errors: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d: what should be zero in each row.
 *
 *     0 = (a + b*d.x[row]) - y
 */
static void d_values(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double d_x_row = inputs[2];  /* d.x[row] */
    const double y = inputs[3];

    outputs[0] = a + b * d_x_row - y;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(a, coordinate 1)
 *     d(component 1) / d(b, coordinate 1)
 *     d(component 1) / d(d.x[row], coordinate 1)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double a = inputs[0];
    const double b = inputs[1];
    const double d_x_row = inputs[2];  /* d.x[row] */
    const double y = inputs[3];

    outputs[0] = a + b * d_x_row - y;
    outputs[1] = 1.0;
    outputs[2] = d_x_row;
    outputs[3] = b;
}

/*
 * d_x: what should be zero in each row.
 *
 *     0 = d.x[row] - x
 */
static void d_x_values(const double *inputs, double *outputs)
{
    const double d_x_row = inputs[0];  /* d.x[row] */
    const double x = inputs[1];

    outputs[0] = d_x_row - x;
}

/*
 * d_x: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(d.x[row], coordinate 1)
 */
static void d_x_slopes(const double *inputs, double *outputs)
{
    const double d_x_row = inputs[0];  /* d.x[row] */
    const double x = inputs[1];

    outputs[0] = d_x_row - x;
    outputs[1] = 1.0;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    const double s = inputs[0];

    outputs[0] = s;
}

/* d_x: stated noise. */
static void d_x_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
}

/* a: where the iteration begins. */
static void start_of_a(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 5.0;
}

/* b: where the iteration begins. */
static void start_of_b(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.0;
}

/* d.x: where the iteration begins. */
static void start_of_d_x(const double *inputs, double *outputs)
{
    const double x = inputs[0];

    outputs[0] = x;
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
            d_slopes(inputs + row * 4, outputs + row * 4);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            d_x_values(inputs + row * 2, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            d_x_slopes(inputs + row * 2, outputs + row * 2);
        break;
    default:
        break;
    }
}

