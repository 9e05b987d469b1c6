/* similarity: its equations. Everything is in SI, angles in radians. */

#include <math.h>


/*
 * d: what should be zero in each row.
 *
 *     0 = (((S[4]*cos(S[1]))*x + (S[4]*(-sin(S[1])))*y) + S[2]) - u
 *     0 = (((S[4]*sin(S[1]))*x + (S[4]*cos(S[1]))*y) + S[3]) - v
 */
static void d_values(const double *inputs, double *outputs)
{
    const double S_4 = inputs[0];  /* S[4] */
    const double S_1 = inputs[1];  /* S[1] */
    const double S_2 = inputs[2];  /* S[2] */
    const double S_3 = inputs[3];  /* S[3] */
    const double x = inputs[4];
    const double y = inputs[5];
    const double u = inputs[6];
    const double v = inputs[7];
    const double t1 = S_4 * cos(S_1);
    const double t2 = S_4 * sin(S_1);

    outputs[0] = t1 * x - t2 * y + S_2 - u;
    outputs[1] = t2 * x + t1 * y + S_3 - v;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(S, coordinate 4)
 *     d(component 2) / d(S, coordinate 4)
 *     d(component 1) / d(S, coordinate 1)
 *     d(component 2) / d(S, coordinate 1)
 *     d(component 1) / d(S, coordinate 2)
 *     d(component 2) / d(S, coordinate 3)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double S_4 = inputs[0];  /* S[4] */
    const double S_1 = inputs[1];  /* S[1] */
    const double S_2 = inputs[2];  /* S[2] */
    const double S_3 = inputs[3];  /* S[3] */
    const double x = inputs[4];
    const double y = inputs[5];
    const double u = inputs[6];
    const double v = inputs[7];
    const double t1 = cos(S_1);
    const double t2 = S_4 * t1;
    const double t3 = sin(S_1);
    const double t4 = S_4 * t3;

    outputs[0] = t2 * x - t4 * y + S_2 - u;
    outputs[1] = t4 * x + t2 * y + S_3 - v;
    outputs[2] = (x * t1 - y * t3) * S_4;
    outputs[3] = (x * t3 + y * t1) * S_4;
    outputs[4] = -(x * t4 + y * t2);
    outputs[5] = x * t2 - y * t4;
    outputs[6] = 1.0;
    outputs[7] = 1.0;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.1;
    outputs[1] = 0.1;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 8, outputs + row * 2);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 8, outputs + row * 8);
        break;
    default:
        break;
    }
}

