/* keys: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d: what should be zero in each row.
 *
 *     0 = m - y
 */
static void d_values(const double *inputs, double *outputs)
{
    const double m = inputs[0];
    const double y = inputs[1];

    outputs[0] = m - y;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(m, coordinate 1)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double m = inputs[0];
    const double y = inputs[1];

    outputs[0] = m - y;
    outputs[1] = 1.0;
}

/*
 * e: what should be zero in each row.
 *
 *     0 = s*m - z
 */
static void e_values(const double *inputs, double *outputs)
{
    const double m = inputs[0];
    const double s = inputs[1];
    const double z = inputs[2];

    outputs[0] = s * m - z;
}

/*
 * e: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(m, coordinate 1)
 */
static void e_slopes(const double *inputs, double *outputs)
{
    const double m = inputs[0];
    const double s = inputs[1];
    const double z = inputs[2];

    outputs[0] = s * m - z;
    outputs[1] = s;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.5;
}

/* e: stated noise. */
static void e_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.5;
}

/* m: where the iteration begins. */
static void start_of_m(const double *inputs, double *outputs)
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
            d_values(inputs + row * 2, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 2, outputs + row * 2);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            e_values(inputs + row * 3, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            e_slopes(inputs + row * 3, outputs + row * 2);
        break;
    default:
        break;
    }
}

