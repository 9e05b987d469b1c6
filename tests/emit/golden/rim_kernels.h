/* rim: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

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

/*
 * d_y: what should be zero in each row.
 *
 *     0 = d.y[row] - y
 */
static void d_y_values(const double *inputs, double *outputs)
{
    const double d_y_row = inputs[0];  /* d.y[row] */
    const double y = inputs[1];

    outputs[0] = d_y_row - y;
}

/*
 * d_y: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(d.y[row], coordinate 1)
 */
static void d_y_slopes(const double *inputs, double *outputs)
{
    const double d_y_row = inputs[0];  /* d.y[row] */
    const double y = inputs[1];

    outputs[0] = d_y_row - y;
    outputs[1] = 1.0;
}

/*
 * d: what should be zero in each row.
 *
 *     0 = r - sqrt((d.x[row] - c[1])**2 + (d.y[row] - c[2])**2)
 */
static void d_values(const double *inputs, double *outputs)
{
    const double r = inputs[0];
    const double d_x_row = inputs[1];  /* d.x[row] */
    const double c_1 = inputs[2];  /* c[1] */
    const double d_y_row = inputs[3];  /* d.y[row] */
    const double c_2 = inputs[4];  /* c[2] */

    outputs[0] = r - sqrt(kernel_square(d_x_row - c_1) + kernel_square(d_y_row - c_2));
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(r, coordinate 1)
 *     d(component 1) / d(d.x[row], coordinate 1)
 *     d(component 1) / d(c, coordinate 1)
 *     d(component 1) / d(d.y[row], coordinate 1)
 *     d(component 1) / d(c, coordinate 2)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double r = inputs[0];
    const double d_x_row = inputs[1];  /* d.x[row] */
    const double c_1 = inputs[2];  /* c[1] */
    const double d_y_row = inputs[3];  /* d.y[row] */
    const double c_2 = inputs[4];  /* c[2] */
    const double t1 = d_x_row - c_1;
    const double t2 = d_y_row - c_2;
    const double t3 = sqrt(kernel_square(t1) + kernel_square(t2));
    const double t4 = t1 / t3;
    const double t5 = t2 / t3;

    outputs[0] = r - t3;
    outputs[1] = 1.0;
    outputs[2] = -t4;
    outputs[3] = t4;
    outputs[4] = -t5;
    outputs[5] = t5;
}

/* d_x: stated noise. */
static void d_x_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.02;
}

/* d_y: stated noise. */
static void d_y_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.03;
}

/* c: where the iteration begins. */
static void start_of_c(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
    outputs[1] = 0.1;
}

/* r: where the iteration begins. */
static void start_of_r(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.1;
}

/* d.x: where the iteration begins. */
static void start_of_d_x(const double *inputs, double *outputs)
{
    const double x = inputs[0];

    outputs[0] = x;
}

/* d.y: where the iteration begins. */
static void start_of_d_y(const double *inputs, double *outputs)
{
    const double y = inputs[0];

    outputs[0] = y;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_x_values(inputs + row * 2, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_x_slopes(inputs + row * 2, outputs + row * 2);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            d_y_values(inputs + row * 2, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            d_y_slopes(inputs + row * 2, outputs + row * 2);
        break;
    case 4:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 5, outputs + row * 1);
        break;
    case 5:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 5, outputs + row * 6);
        break;
    default:
        break;
    }
}

