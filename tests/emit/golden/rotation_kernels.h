/* rotation: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }
static double kernel_not(double a) { return a == 0.0 ? 1.0 : 0.0; }
static double kernel_less(double a, double b) { return a < b ? 1.0 : 0.0; }
static double kernel_select(double test, double value) { return test != 0.0 ? value : 0.0; }

/*
 * d: what should be zero in each row.
 *
 *     0 = (((1 - (2*(R[3]*R[3]) + 2*(R[4]*R[4])))*x + (2*(R[2]*R[3]) - 2*R[1]*R[4])*y) + (2*(R[2]*R[4]) +
 *         2*(R[1]*R[3]))*z) - u
 *     0 = (((2*(R[2]*R[3]) + 2*(R[1]*R[4]))*x + (1 - (2*(R[2]*R[2]) + 2*(R[4]*R[4])))*y) + (2*(R[3]*R[4]) -
 *         2*R[1]*R[2])*z) - v
 *     0 = (((2*(R[2]*R[4]) - 2*R[1]*R[3])*x + (2*(R[3]*R[4]) + 2*(R[1]*R[2]))*y) + (1 - (2*(R[2]*R[2]) +
 *         2*(R[3]*R[3])))*z) - w
 */
static void d_values(const double *inputs, double *outputs)
{
    const double R_1 = inputs[0];  /* R[1] */
    const double R_2 = inputs[1];  /* R[2] */
    const double R_3 = inputs[2];  /* R[3] */
    const double R_4 = inputs[3];  /* R[4] */
    const double x = inputs[4];
    const double y = inputs[5];
    const double z = inputs[6];
    const double u = inputs[7];
    const double v = inputs[8];
    const double w = inputs[9];
    const double t1 = 2.0 * kernel_square(R_3);
    const double t2 = 2.0 * kernel_square(R_4);
    const double t3 = 2.0 * (R_2 * R_3);
    const double t4 = 2.0 * (R_1 * R_4);
    const double t5 = 2.0 * (R_2 * R_4);
    const double t6 = 2.0 * (R_1 * R_3);
    const double t7 = 2.0 * kernel_square(R_2);
    const double t8 = 2.0 * (R_3 * R_4);
    const double t9 = 2.0 * (R_1 * R_2);

    outputs[0] = (1.0 - (t1 + t2)) * x + (t3 - t4) * y + (t5 + t6) * z - u;
    outputs[1] = (t3 + t4) * x + (1.0 - (t7 + t2)) * y + (t8 - t9) * z - v;
    outputs[2] = (t5 - t6) * x + (t8 + t9) * y + (1.0 - (t7 + t1)) * z - w;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(R, coordinate 1)
 *     d(component 2) / d(R, coordinate 1)
 *     d(component 3) / d(R, coordinate 1)
 *     d(component 1) / d(R, coordinate 2)
 *     d(component 2) / d(R, coordinate 2)
 *     d(component 3) / d(R, coordinate 2)
 *     d(component 1) / d(R, coordinate 3)
 *     d(component 2) / d(R, coordinate 3)
 *     d(component 3) / d(R, coordinate 3)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double R_1 = inputs[0];  /* R[1] */
    const double R_2 = inputs[1];  /* R[2] */
    const double R_3 = inputs[2];  /* R[3] */
    const double R_4 = inputs[3];  /* R[4] */
    const double x = inputs[4];
    const double y = inputs[5];
    const double z = inputs[6];
    const double u = inputs[7];
    const double v = inputs[8];
    const double w = inputs[9];
    const double t1 = 2.0 * kernel_square(R_3);
    const double t2 = 2.0 * kernel_square(R_4);
    const double t3 = 2.0 * (R_2 * R_3);
    const double t4 = 2.0 * (R_1 * R_4);
    const double t5 = 2.0 * (R_2 * R_4);
    const double t6 = 2.0 * (R_1 * R_3);
    const double t7 = 2.0 * kernel_square(R_2);
    const double t8 = 2.0 * (R_3 * R_4);
    const double t9 = 2.0 * (R_1 * R_2);
    const double t10 = 2.0 * R_3;
    const double t11 = y * t10;
    const double t12 = 2.0 * R_4;
    const double t13 = z * t12;
    const double t14 = t11 + t13;
    const double t15 = 0.5 * R_1;
    const double t16 = z * t10;
    const double t17 = y * t12;
    const double t18 = t16 - t17;
    const double t19 = 0.5 * R_2;
    const double t20 = 2.0 * R_2;
    const double t21 = y * t20;
    const double t22 = 4.0 * R_3;
    const double t23 = 2.0 * R_1;
    const double t24 = z * t23;
    const double t25 = t21 - x * t22 + t24;
    const double t26 = 0.5 * R_4;
    const double t27 = z * t20;
    const double t28 = 4.0 * R_4;
    const double t29 = y * t23;
    const double t30 = t27 - (x * t28 + t29);
    const double t31 = 0.5 * R_3;
    const double t32 = x * t10;
    const double t33 = 4.0 * R_2;
    const double t34 = t32 - y * t33 - t24;
    const double t35 = x * t12;
    const double t36 = t35 - t27;
    const double t37 = x * t20;
    const double t38 = t37 + t13;
    const double t39 = x * t23;
    const double t40 = t39 - y * t28 + t16;
    const double t41 = t35 + t29 - z * t33;
    const double t42 = t21 - t32;
    const double t43 = t17 - t39 - z * t22;
    const double t44 = t37 + t11;

    outputs[0] = (1.0 - (t1 + t2)) * x + (t3 - t4) * y + (t5 + t6) * z - u;
    outputs[1] = (t3 + t4) * x + (1.0 - (t7 + t2)) * y + (t8 - t9) * z - v;
    outputs[2] = (t5 - t6) * x + (t8 + t9) * y + (1.0 - (t7 + t1)) * z - w;
    outputs[3] = t14 * t15 - t18 * t19 + t25 * t26 - t30 * t31;
    outputs[4] = t34 * t15 - t36 * t19 + t38 * t26 - t40 * t31;
    outputs[5] = t41 * t15 - t42 * t19 + t43 * t26 - t44 * t31;
    outputs[6] = t25 * t15 - (t18 * t31 + t14 * t26) + t30 * t19;
    outputs[7] = t38 * t15 - (t36 * t31 + t34 * t26) + t40 * t19;
    outputs[8] = t43 * t15 - (t42 * t31 + t41 * t26) + t44 * t19;
    outputs[9] = t14 * t31 - t18 * t26 - t25 * t19 + t30 * t15;
    outputs[10] = t34 * t31 - t36 * t26 - t38 * t19 + t40 * t15;
    outputs[11] = t41 * t31 - t42 * t26 - t43 * t19 + t44 * t15;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.01;
    outputs[1] = 0.01;
    outputs[2] = 0.01;
}

/* R: where the iteration begins. */
static void start_of_R(const double *inputs, double *outputs)
{
    (void)inputs;
    const double t1 = kernel_less(1.02, 0.0025);
    const double t2 = kernel_select(t1, 1.0) + kernel_select(kernel_not(t1), 1.02);
    const double t3 = sqrt(t2);
    const double t4 = sin(t3 / 2.0);
    const double t5 = kernel_select(t1, 0.45891868035714284) + kernel_select(kernel_not(t1), 2.0 * (t4 * t4) /
        t2);
    const double t6 = kernel_select(t1, 0.8384594428571428) + kernel_select(kernel_not(t1), sin(t3) / t3);

    outputs[0] = 1.0 - t5 * 1.02 + t5 * 0.010000000000000002;
    outputs[1] = t5 * -0.010000000000000002 - t6 * 1.0;
    outputs[2] = t5 * 0.1 + t6 * -0.1;
    outputs[3] = t5 * -0.010000000000000002 + t6 * 1.0;
    outputs[4] = 1.0 - t5 * 1.02 + t5 * 0.010000000000000002;
    outputs[5] = t5 * -0.1 - t6 * 0.1;
    outputs[6] = t5 * 0.1 - t6 * -0.1;
    outputs[7] = t5 * -0.1 + t6 * 0.1;
    outputs[8] = 1.0 - t5 * 1.02 + t5 * 1.0;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 10, outputs + row * 3);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 10, outputs + row * 12);
        break;
    default:
        break;
    }
}

