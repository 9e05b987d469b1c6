/* pose: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }
static double kernel_not(double a) { return a == 0.0 ? 1.0 : 0.0; }
static double kernel_less(double a, double b) { return a < b ? 1.0 : 0.0; }
static double kernel_select(double test, double value) { return test != 0.0 ? value : 0.0; }

/*
 * d: what should be zero in each row.
 *
 *     0 = ((((1 - (2*(T[3]*T[3]) + 2*(T[4]*T[4])))*x + (2*(T[2]*T[3]) - 2*T[1]*T[4])*y) + (2*(T[2]*T[4]) +
 *         2*(T[1]*T[3]))*z) + T[5]) - u
 *     0 = ((((2*(T[2]*T[3]) + 2*(T[1]*T[4]))*x + (1 - (2*(T[2]*T[2]) + 2*(T[4]*T[4])))*y) + (2*(T[3]*T[4]) -
 *         2*T[1]*T[2])*z) + T[6]) - v
 *     0 = ((((2*(T[2]*T[4]) - 2*T[1]*T[3])*x + (2*(T[3]*T[4]) + 2*(T[1]*T[2]))*y) + (1 - (2*(T[2]*T[2]) +
 *         2*(T[3]*T[3])))*z) + T[7]) - w
 */
static void d_values(const double *inputs, double *outputs)
{
    const double T_1 = inputs[0];  /* T[1] */
    const double T_2 = inputs[1];  /* T[2] */
    const double T_3 = inputs[2];  /* T[3] */
    const double T_4 = inputs[3];  /* T[4] */
    const double T_5 = inputs[4];  /* T[5] */
    const double T_6 = inputs[5];  /* T[6] */
    const double T_7 = inputs[6];  /* T[7] */
    const double x = inputs[7];
    const double y = inputs[8];
    const double z = inputs[9];
    const double u = inputs[10];
    const double v = inputs[11];
    const double w = inputs[12];
    const double t1 = 2.0 * kernel_square(T_3);
    const double t2 = 2.0 * kernel_square(T_4);
    const double t3 = 2.0 * (T_2 * T_3);
    const double t4 = 2.0 * (T_1 * T_4);
    const double t5 = 2.0 * (T_2 * T_4);
    const double t6 = 2.0 * (T_1 * T_3);
    const double t7 = 2.0 * kernel_square(T_2);
    const double t8 = 2.0 * (T_3 * T_4);
    const double t9 = 2.0 * (T_1 * T_2);

    outputs[0] = (1.0 - (t1 + t2)) * x + (t3 - t4) * y + (t5 + t6) * z + T_5 - u;
    outputs[1] = (t3 + t4) * x + (1.0 - (t7 + t2)) * y + (t8 - t9) * z + T_6 - v;
    outputs[2] = (t5 - t6) * x + (t8 + t9) * y + (1.0 - (t7 + t1)) * z + T_7 - w;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(T, coordinate 1)
 *     d(component 2) / d(T, coordinate 1)
 *     d(component 3) / d(T, coordinate 1)
 *     d(component 1) / d(T, coordinate 2)
 *     d(component 2) / d(T, coordinate 2)
 *     d(component 3) / d(T, coordinate 2)
 *     d(component 1) / d(T, coordinate 3)
 *     d(component 2) / d(T, coordinate 3)
 *     d(component 3) / d(T, coordinate 3)
 *     d(component 1) / d(T, coordinate 4)
 *     d(component 2) / d(T, coordinate 5)
 *     d(component 3) / d(T, coordinate 6)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double T_1 = inputs[0];  /* T[1] */
    const double T_2 = inputs[1];  /* T[2] */
    const double T_3 = inputs[2];  /* T[3] */
    const double T_4 = inputs[3];  /* T[4] */
    const double T_5 = inputs[4];  /* T[5] */
    const double T_6 = inputs[5];  /* T[6] */
    const double T_7 = inputs[6];  /* T[7] */
    const double x = inputs[7];
    const double y = inputs[8];
    const double z = inputs[9];
    const double u = inputs[10];
    const double v = inputs[11];
    const double w = inputs[12];
    const double t1 = 2.0 * kernel_square(T_3);
    const double t2 = 2.0 * kernel_square(T_4);
    const double t3 = 2.0 * (T_2 * T_3);
    const double t4 = 2.0 * (T_1 * T_4);
    const double t5 = 2.0 * (T_2 * T_4);
    const double t6 = 2.0 * (T_1 * T_3);
    const double t7 = 2.0 * kernel_square(T_2);
    const double t8 = 2.0 * (T_3 * T_4);
    const double t9 = 2.0 * (T_1 * T_2);
    const double t10 = 2.0 * T_3;
    const double t11 = y * t10;
    const double t12 = 2.0 * T_4;
    const double t13 = z * t12;
    const double t14 = t11 + t13;
    const double t15 = 0.5 * T_1;
    const double t16 = z * t10;
    const double t17 = y * t12;
    const double t18 = t16 - t17;
    const double t19 = 0.5 * T_2;
    const double t20 = 2.0 * T_2;
    const double t21 = y * t20;
    const double t22 = 4.0 * T_3;
    const double t23 = 2.0 * T_1;
    const double t24 = z * t23;
    const double t25 = t21 - x * t22 + t24;
    const double t26 = 0.5 * T_4;
    const double t27 = z * t20;
    const double t28 = 4.0 * T_4;
    const double t29 = y * t23;
    const double t30 = t27 - (x * t28 + t29);
    const double t31 = 0.5 * T_3;
    const double t32 = x * t10;
    const double t33 = 4.0 * T_2;
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

    outputs[0] = (1.0 - (t1 + t2)) * x + (t3 - t4) * y + (t5 + t6) * z + T_5 - u;
    outputs[1] = (t3 + t4) * x + (1.0 - (t7 + t2)) * y + (t8 - t9) * z + T_6 - v;
    outputs[2] = (t5 - t6) * x + (t8 + t9) * y + (1.0 - (t7 + t1)) * z + T_7 - w;
    outputs[3] = t14 * t15 - t18 * t19 + t25 * t26 - t30 * t31;
    outputs[4] = t34 * t15 - t36 * t19 + t38 * t26 - t40 * t31;
    outputs[5] = t41 * t15 - t42 * t19 + t43 * t26 - t44 * t31;
    outputs[6] = t25 * t15 - (t18 * t31 + t14 * t26) + t30 * t19;
    outputs[7] = t38 * t15 - (t36 * t31 + t34 * t26) + t40 * t19;
    outputs[8] = t43 * t15 - (t42 * t31 + t41 * t26) + t44 * t19;
    outputs[9] = t14 * t31 - t18 * t26 - t25 * t19 + t30 * t15;
    outputs[10] = t34 * t31 - t36 * t26 - t38 * t19 + t40 * t15;
    outputs[11] = t41 * t31 - t42 * t26 - t43 * t19 + t44 * t15;
    outputs[12] = 1.0;
    outputs[13] = 1.0;
    outputs[14] = 1.0;
}

/*
 * e: what should be zero in each row.
 *
 *     0 = (offset + n[1]) - (s + offset)
 */
static void e_values(const double *inputs, double *outputs)
{
    const double n_1 = inputs[0];  /* n[1] */
    const double s = inputs[3];
    const double offset = inputs[4];

    outputs[0] = offset + n_1 - (s + offset);
}

/*
 * e: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(n, coordinate 1)
 *     d(component 1) / d(n, coordinate 2)
 */
static void e_slopes(const double *inputs, double *outputs)
{
    const double n_1 = inputs[0];  /* n[1] */
    const double n_2 = inputs[1];  /* n[2] */
    const double n_3 = inputs[2];  /* n[3] */
    const double s = inputs[3];
    const double offset = inputs[4];
    const double t1 = kernel_less(n_3, 0.0);
    const double t2 = kernel_select(t1, -1.0) + kernel_select(kernel_not(t1), 1.0);
    const double t3 = -1.0 / (t2 + n_3);

    outputs[0] = offset + n_1 - (s + offset);
    outputs[1] = 1.0 + t2 * n_1 * n_1 * t3;
    outputs[2] = n_1 * n_2 * t3;
}

/*
 * turned: what should be zero in each row.
 *
 *     0 = n[2] - 1.4*s
 */
static void turned_values(const double *inputs, double *outputs)
{
    const double n_2 = inputs[1];  /* n[2] */
    const double s = inputs[3];

    outputs[0] = n_2 - 1.4 * s;
}

/*
 * turned: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(n, coordinate 1)
 *     d(component 1) / d(n, coordinate 2)
 */
static void turned_slopes(const double *inputs, double *outputs)
{
    const double n_1 = inputs[0];  /* n[1] */
    const double n_2 = inputs[1];  /* n[2] */
    const double n_3 = inputs[2];  /* n[3] */
    const double s = inputs[3];
    const double t1 = kernel_less(n_3, 0.0);
    const double t2 = kernel_select(t1, -1.0) + kernel_select(kernel_not(t1), 1.0);
    const double t3 = -1.0 / (t2 + n_3);

    outputs[0] = n_2 - 1.4 * s;
    outputs[1] = t2 * (n_1 * n_2 * t3);
    outputs[2] = t2 + kernel_square(n_2) * t3;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.01;
    outputs[1] = 0.01;
    outputs[2] = 0.01;
}

/* e: stated noise. */
static void e_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.05;
}

/* turned: stated noise. */
static void turned_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.05;
}

/* T: where the iteration begins. */
static void start_of_T(const double *inputs, double *outputs)
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
    outputs[9] = 2.0;
    outputs[10] = 1.0;
    outputs[11] = 0.0;
}

/* n: where the iteration begins. */
static void start_of_n(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 1.0;
    outputs[1] = 2.0;
    outputs[2] = 3.0;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 13, outputs + row * 3);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 13, outputs + row * 15);
        break;
    case 2:
        for (row = 0; row < rows; row++)
            e_values(inputs + row * 5, outputs + row * 1);
        break;
    case 3:
        for (row = 0; row < rows; row++)
            e_slopes(inputs + row * 5, outputs + row * 3);
        break;
    case 4:
        for (row = 0; row < rows; row++)
            turned_values(inputs + row * 4, outputs + row * 1);
        break;
    case 5:
        for (row = 0; row < rows; row++)
            turned_slopes(inputs + row * 4, outputs + row * 3);
        break;
    default:
        break;
    }
}

/* Constants of the problem. */
static const double constant_offset = 0.5;    /* offset */
