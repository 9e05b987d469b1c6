/* equations: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d_1: what should be zero in each row.
 *
 *     0 = q[1] - angle
 */
static void d_1_values(const double *inputs, double *outputs)
{
    const double q_1 = inputs[0];  /* q[1] */
    const double angle = inputs[1];

    outputs[0] = q_1 - angle;
}

/*
 * d_1: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(q, coordinate 1)
 */
static void d_1_slopes(const double *inputs, double *outputs)
{
    const double q_1 = inputs[0];  /* q[1] */
    const double angle = inputs[1];

    outputs[0] = q_1 - angle;
    outputs[1] = 1.0;
}

/*
 * d_2: what should be zero in each row.
 *
 *     0 = q[2] - angle
 */
static void d_2_values(const double *inputs, double *outputs)
{
    const double q_2 = inputs[0];  /* q[2] */
    const double angle = inputs[1];

    outputs[0] = q_2 - angle;
}

/*
 * d_2: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(q, coordinate 2)
 */
static void d_2_slopes(const double *inputs, double *outputs)
{
    const double q_2 = inputs[0];  /* q[2] */
    const double angle = inputs[1];

    outputs[0] = q_2 - angle;
    outputs[1] = 1.0;
}

/*
 * d_3: what should be zero in each row.
 *
 *     0 = q[3] - angle
 */
static void d_3_values(const double *inputs, double *outputs)
{
    const double q_3 = inputs[0];  /* q[3] */
    const double angle = inputs[1];

    outputs[0] = q_3 - angle;
}

/*
 * d_3: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(q, coordinate 3)
 */
static void d_3_slopes(const double *inputs, double *outputs)
{
    const double q_3 = inputs[0];  /* q[3] */
    const double angle = inputs[1];

    outputs[0] = q_3 - angle;
    outputs[1] = 1.0;
}

/*
 * q_1_q_2_q_3_180: what should be zero in each row.
 *
 *     0 = ((q[1] + q[2]) + q[3]) - 1*180
 */
static void q_1_q_2_q_3_180_values(const double *inputs, double *outputs)
{
    const double q_1 = inputs[0];  /* q[1] */
    const double q_2 = inputs[1];  /* q[2] */
    const double q_3 = inputs[2];  /* q[3] */

    outputs[0] = q_1 + q_2 + q_3 + -180.0;
}

/*
 * q_1_q_2_q_3_180: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(q, coordinate 1)
 *     d(component 1) / d(q, coordinate 2)
 *     d(component 1) / d(q, coordinate 3)
 */
static void q_1_q_2_q_3_180_slopes(const double *inputs, double *outputs)
{
    const double q_1 = inputs[0];  /* q[1] */
    const double q_2 = inputs[1];  /* q[2] */
    const double q_3 = inputs[2];  /* q[3] */

    outputs[0] = q_1 + q_2 + q_3 + -180.0;
    outputs[1] = 1.0;
    outputs[2] = 1.0;
    outputs[3] = 1.0;
}

/* d_1: stated noise. */
static void d_1_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
}

/* d_2: stated noise. */
static void d_2_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
}

/* d_3: stated noise. */
static void d_3_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
}

/* q: where the iteration begins. */
static void start_of_q(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 60.0;
    outputs[1] = 60.0;
    outputs[2] = 60.0;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_1_values(inputs + row * 2, outputs + row * 1);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_1_slopes(inputs + row * 2, outputs + row * 2);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            d_2_values(inputs + row * 2, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            d_2_slopes(inputs + row * 2, outputs + row * 2);
        break;
    case 4:
        for (row = 0; row < rows; row++)
            d_3_values(inputs + row * 2, outputs + row * 1);
        break;
    case 5:
        for (row = 0; row < rows; row++)
            d_3_slopes(inputs + row * 2, outputs + row * 2);
        break;
    case 6:
        for (row = 0; row < rows; row++)
            q_1_q_2_q_3_180_values(inputs + row * 3, outputs + row * 1);
        break;
    case 7:
        for (row = 0; row < rows; row++)
            q_1_q_2_q_3_180_slopes(inputs + row * 3, outputs + row * 4);
        break;
    default:
        break;
    }
}

