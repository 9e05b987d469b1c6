/* moved-masts: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

/*
 * ranges: what should be zero in each row.
 *
 *     0 = sqrt((p[1] - masts.x[mast])*(p[1] - masts.x[mast]) + (p[2] - masts.y)*(p[2] - masts.y)) - r
 */
static void ranges_values(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double masts_x_mast = inputs[1];  /* masts.x[mast] */
    const double p_2 = inputs[2];  /* p[2] */
    const double masts_y = inputs[3];  /* masts.y */
    const double r = inputs[4];

    outputs[0] = sqrt(kernel_square(p_1 - masts_x_mast) + kernel_square(p_2 - masts_y)) - r;
}

/*
 * ranges: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(p, coordinate 1)
 *     d(component 1) / d(masts.x[mast], coordinate 1)
 *     d(component 1) / d(p, coordinate 2)
 */
static void ranges_slopes(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double masts_x_mast = inputs[1];  /* masts.x[mast] */
    const double p_2 = inputs[2];  /* p[2] */
    const double masts_y = inputs[3];  /* masts.y */
    const double r = inputs[4];
    const double t1 = p_1 - masts_x_mast;
    const double t2 = p_2 - masts_y;
    const double t3 = sqrt(kernel_square(t1) + kernel_square(t2));
    const double t4 = t1 / t3;

    outputs[0] = t3 - r;
    outputs[1] = t4;
    outputs[2] = -t4;
    outputs[3] = t2 / t3;
}

/*
 * masts_x: what should be zero in each row.
 *
 *     0 = masts.x[id] - x
 */
static void masts_x_values(const double *inputs, double *outputs)
{
    const double masts_x_id = inputs[0];  /* masts.x[id] */
    const double x = inputs[1];

    outputs[0] = masts_x_id - x;
}

/*
 * masts_x: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(masts.x[id], coordinate 1)
 */
static void masts_x_slopes(const double *inputs, double *outputs)
{
    const double masts_x_id = inputs[0];  /* masts.x[id] */
    const double x = inputs[1];

    outputs[0] = masts_x_id - x;
    outputs[1] = 1.0;
}

/* ranges: stated noise. */
static void ranges_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.05;
}

/* masts_x: stated noise. */
static void masts_x_noise(const double *inputs, double *outputs)
{
    const double s = inputs[0];

    outputs[0] = s;
}

/* p: where the iteration begins. */
static void start_of_p(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
    outputs[1] = 1.0;
}

/* masts.x: where the iteration begins. */
static void start_of_masts_x(const double *inputs, double *outputs)
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
            ranges_values(inputs + row * 5, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            ranges_slopes(inputs + row * 5, outputs + row * 4);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            masts_x_values(inputs + row * 2, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            masts_x_slopes(inputs + row * 2, outputs + row * 2);
        break;
    default:
        break;
    }
}

