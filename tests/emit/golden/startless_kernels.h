/* startless: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

/*
 * ranges: what should be zero in each row.
 *
 *     0 = sqrt((p[1] - masts.x)*(p[1] - masts.x) + (p[2] - masts.y)*(p[2] - masts.y)) - r
 */
static void ranges_values(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double p_2 = inputs[1];  /* p[2] */
    const double masts_x = inputs[2];  /* masts.x */
    const double masts_y = inputs[3];  /* masts.y */
    const double r = inputs[4];

    outputs[0] = sqrt(kernel_square(p_1 - masts_x) + kernel_square(p_2 - masts_y)) - r;
}

/*
 * ranges: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(p, coordinate 1)
 *     d(component 1) / d(p, coordinate 2)
 */
static void ranges_slopes(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double p_2 = inputs[1];  /* p[2] */
    const double masts_x = inputs[2];  /* masts.x */
    const double masts_y = inputs[3];  /* masts.y */
    const double r = inputs[4];
    const double t1 = p_1 - masts_x;
    const double t2 = p_2 - masts_y;
    const double t3 = sqrt(kernel_square(t1) + kernel_square(t2));

    outputs[0] = t3 - r;
    outputs[1] = t1 / t3;
    outputs[2] = t2 / t3;
}

/* ranges: stated noise. */
static void ranges_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.05;
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
            ranges_slopes(inputs + row * 5, outputs + row * 3);
        break;
    default:
        break;
    }
}

