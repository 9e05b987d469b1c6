/* offset: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

/*
 * ranges: what should be zero in each row.
 *
 *     0 = (o + sqrt((p[1] - masts.x)*(p[1] - masts.x) + (p[2] - masts.y)*(p[2] - masts.y))) - r
 */
static void ranges_values(const double *inputs, double *outputs)
{
    const double o = inputs[0];
    const double p_1 = inputs[1];  /* p[1] */
    const double p_2 = inputs[2];  /* p[2] */
    const double masts_x = inputs[3];  /* masts.x */
    const double masts_y = inputs[4];  /* masts.y */
    const double r = inputs[5];

    outputs[0] = o + sqrt(kernel_square(p_1 - masts_x) + kernel_square(p_2 - masts_y)) - r;
}

/*
 * ranges: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(o, coordinate 1)
 *     d(component 1) / d(p, coordinate 1)
 *     d(component 1) / d(p, coordinate 2)
 */
static void ranges_slopes(const double *inputs, double *outputs)
{
    const double o = inputs[0];
    const double p_1 = inputs[1];  /* p[1] */
    const double p_2 = inputs[2];  /* p[2] */
    const double masts_x = inputs[3];  /* masts.x */
    const double masts_y = inputs[4];  /* masts.y */
    const double r = inputs[5];
    const double t1 = p_1 - masts_x;
    const double t2 = p_2 - masts_y;
    const double t3 = sqrt(kernel_square(t1) + kernel_square(t2));

    outputs[0] = o + t3 - r;
    outputs[1] = 1.0;
    outputs[2] = t1 / t3;
    outputs[3] = t2 / t3;
}

/* ranges: stated noise. */
static void ranges_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
}

/* p: where the iteration begins. */
static void start_of_p(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
    outputs[1] = 1.0;
}

/* o: where the iteration begins. */
static void start_of_o(const double *inputs, double *outputs)
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
            ranges_values(inputs + row * 6, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            ranges_slopes(inputs + row * 6, outputs + row * 4);
        break;
    default:
        break;
    }
}

