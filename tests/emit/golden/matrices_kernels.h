/* matrices: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d: what should be zero in each row.
 *
 *     0 = (p[1] + t*w[1]) - u
 *     0 = (p[2] + t*w[2]) - v
 */
static void d_values(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double w_1 = inputs[1];  /* w[1] */
    const double p_2 = inputs[2];  /* p[2] */
    const double w_2 = inputs[3];  /* w[2] */
    const double t = inputs[4];
    const double u = inputs[5];
    const double v = inputs[6];

    outputs[0] = p_1 + t * w_1 - u;
    outputs[1] = p_2 + t * w_2 - v;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(p, coordinate 1)
 *     d(component 1) / d(w, coordinate 1)
 *     d(component 2) / d(p, coordinate 2)
 *     d(component 2) / d(w, coordinate 2)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double w_1 = inputs[1];  /* w[1] */
    const double p_2 = inputs[2];  /* p[2] */
    const double w_2 = inputs[3];  /* w[2] */
    const double t = inputs[4];
    const double u = inputs[5];
    const double v = inputs[6];

    outputs[0] = p_1 + t * w_1 - u;
    outputs[1] = p_2 + t * w_2 - v;
    outputs[2] = 1.0;
    outputs[3] = t;
    outputs[4] = 1.0;
    outputs[5] = t;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    const double s = inputs[0];
    const double c = inputs[1];

    outputs[0] = s;
    outputs[1] = c;
    outputs[2] = c;
    outputs[3] = 2.0 * s;
}

/* p: where the iteration begins. */
static void start_of_p(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.0;
    outputs[1] = 0.0;
}

/* w: where the iteration begins. */
static void start_of_w(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
    outputs[1] = 1.0;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 7, outputs + row * 2);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 7, outputs + row * 6);
        break;
    default:
        break;
    }
}

