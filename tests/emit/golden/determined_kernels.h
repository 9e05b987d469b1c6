/* determined: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d: what should be zero in each row.
 *
 *     0 = (p[1]*x + p[2]) - y
 *     0 = p[3]*(1 + 0.1*p[1]) - z
 */
static void d_values(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double p_2 = inputs[1];  /* p[2] */
    const double p_3 = inputs[2];  /* p[3] */
    const double x = inputs[3];
    const double y = inputs[4];
    const double z = inputs[5];

    outputs[0] = p_1 * x + p_2 - y;
    outputs[1] = p_3 * (1.0 + 0.1 * p_1) - z;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(p, coordinate 1)
 *     d(component 2) / d(p, coordinate 1)
 *     d(component 1) / d(p, coordinate 2)
 *     d(component 2) / d(p, coordinate 3)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double p_2 = inputs[1];  /* p[2] */
    const double p_3 = inputs[2];  /* p[3] */
    const double x = inputs[3];
    const double y = inputs[4];
    const double z = inputs[5];
    const double t1 = 1.0 + 0.1 * p_1;

    outputs[0] = p_1 * x + p_2 - y;
    outputs[1] = p_3 * t1 - z;
    outputs[2] = x;
    outputs[3] = 0.1 * p_3;
    outputs[4] = 1.0;
    outputs[5] = t1;
}

/*
 * p_1_p_2_p_3: what should be zero in each row.
 *
 *     0 = p[1] - (p[2] + p[3])
 */
static void p_1_p_2_p_3_values(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double p_2 = inputs[1];  /* p[2] */
    const double p_3 = inputs[2];  /* p[3] */

    outputs[0] = p_1 - (p_2 + p_3);
}

/*
 * p_1_p_2_p_3: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(p, coordinate 1)
 *     d(component 1) / d(p, coordinate 2)
 *     d(component 1) / d(p, coordinate 3)
 */
static void p_1_p_2_p_3_slopes(const double *inputs, double *outputs)
{
    const double p_1 = inputs[0];  /* p[1] */
    const double p_2 = inputs[1];  /* p[2] */
    const double p_3 = inputs[2];  /* p[3] */

    outputs[0] = p_1 - (p_2 + p_3);
    outputs[1] = 1.0;
    outputs[2] = -1.0;
    outputs[3] = -1.0;
}

/*
 * p_3_0_6: what should be zero in each row.
 *
 *     0 >= p[3] - 1*0.6
 */
static void p_3_0_6_values(const double *inputs, double *outputs)
{
    const double p_3 = inputs[0];  /* p[3] */

    outputs[0] = p_3 + -0.6;
}

/*
 * p_3_0_6: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(p, coordinate 3)
 */
static void p_3_0_6_slopes(const double *inputs, double *outputs)
{
    const double p_3 = inputs[0];  /* p[3] */

    outputs[0] = p_3 + -0.6;
    outputs[1] = 1.0;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
    outputs[1] = 0.1;
}

/* p: where the iteration begins. */
static void start_of_p(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
    outputs[1] = 1.0;
    outputs[2] = 1.0;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 6, outputs + row * 2);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 6, outputs + row * 6);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            p_1_p_2_p_3_values(inputs + row * 3, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            p_1_p_2_p_3_slopes(inputs + row * 3, outputs + row * 4);
        break;
    case 4:
        for (row = 0; row < rows; row++)
            p_3_0_6_values(inputs + row * 1, outputs + row * 1);
        break;
    case 5:
        for (row = 0; row < rows; row++)
            p_3_0_6_slopes(inputs + row * 1, outputs + row * 2);
        break;
    default:
        break;
    }
}

