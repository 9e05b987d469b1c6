/* sights: its equations. Everything is in SI, angles in radians. */

#include <math.h>

static double kernel_square(double a) { return a * a; }

/*
 * d: what should be zero in each row.
 *
 *     t1 = 1/((((2*(T[2]*T[4]) - 2*T[1]*T[3])*x + (2*(T[3]*T[4]) + 2*(T[1]*T[2]))*y) + (1 - (2*(T[2]*T[2]) +
 *         2*(T[3]*T[3])))*z) + T[7])
 *     0 = 1*(((((1 - (2*(T[3]*T[3]) + 2*(T[4]*T[4])))*x + (2*(T[2]*T[3]) - 2*T[1]*T[4])*y) + (2*(T[2]*T[4]) +
 *         2*(T[1]*T[3]))*z) + T[5])*t1) - u
 *     0 = 1*(((((2*(T[2]*T[3]) + 2*(T[1]*T[4]))*x + (1 - (2*(T[2]*T[2]) + 2*(T[4]*T[4])))*y) + (2*(T[3]*T[4])
 *         - 2*T[1]*T[2])*z) + T[6])*t1) - v
 */
static void d_values(const double *inputs, double *outputs)
{
    const double T_1 = inputs[0];  /* T[1] */
    const double T_2 = inputs[1];  /* T[2] */
    const double T_3 = inputs[2];  /* T[3] */
    const double T_4 = inputs[3];  /* T[4] */
    const double T_5 = inputs[4];  /* T[5] */
    const double T_7 = inputs[5];  /* T[7] */
    const double T_6 = inputs[6];  /* T[6] */
    const double x = inputs[7];
    const double y = inputs[8];
    const double z = inputs[9];
    const double u = inputs[10];
    const double v = inputs[11];
    const double t1 = 2.0 * kernel_square(T_3);
    const double t2 = 2.0 * kernel_square(T_4);
    const double t3 = 2.0 * (T_2 * T_3);
    const double t4 = 2.0 * (T_1 * T_4);
    const double t5 = 2.0 * (T_2 * T_4);
    const double t6 = 2.0 * (T_1 * T_3);
    const double t7 = 2.0 * (T_3 * T_4);
    const double t8 = 2.0 * (T_1 * T_2);
    const double t9 = 2.0 * kernel_square(T_2);
    const double t10 = (t5 - t6) * x + (t7 + t8) * y + (1.0 - (t9 + t1)) * z + T_7;

    outputs[0] = ((1.0 - (t1 + t2)) * x + (t3 - t4) * y + (t5 + t6) * z + T_5) / t10 - u;
    outputs[1] = ((t3 + t4) * x + (1.0 - (t9 + t2)) * y + (t7 - t8) * z + T_6) / t10 - v;
}

/*
 * d: the same, and behind it the derivatives that are not zero everywhere, in the order
 *
 *     d(component 1) / d(T, coordinate 1)
 *     d(component 2) / d(T, coordinate 1)
 *     d(component 1) / d(T, coordinate 2)
 *     d(component 2) / d(T, coordinate 2)
 *     d(component 1) / d(T, coordinate 3)
 *     d(component 2) / d(T, coordinate 3)
 *     d(component 1) / d(T, coordinate 4)
 *     d(component 1) / d(T, coordinate 6)
 *     d(component 2) / d(T, coordinate 6)
 *     d(component 2) / d(T, coordinate 5)
 */
static void d_slopes(const double *inputs, double *outputs)
{
    const double T_1 = inputs[0];  /* T[1] */
    const double T_2 = inputs[1];  /* T[2] */
    const double T_3 = inputs[2];  /* T[3] */
    const double T_4 = inputs[3];  /* T[4] */
    const double T_5 = inputs[4];  /* T[5] */
    const double T_7 = inputs[5];  /* T[7] */
    const double T_6 = inputs[6];  /* T[6] */
    const double x = inputs[7];
    const double y = inputs[8];
    const double z = inputs[9];
    const double u = inputs[10];
    const double v = inputs[11];
    const double t1 = 2.0 * kernel_square(T_3);
    const double t2 = 2.0 * kernel_square(T_4);
    const double t3 = 2.0 * (T_2 * T_3);
    const double t4 = 2.0 * (T_1 * T_4);
    const double t5 = 2.0 * (T_2 * T_4);
    const double t6 = 2.0 * (T_1 * T_3);
    const double t7 = 2.0 * (T_3 * T_4);
    const double t8 = 2.0 * (T_1 * T_2);
    const double t9 = 2.0 * kernel_square(T_2);
    const double t10 = (t5 - t6) * x + (t7 + t8) * y + (1.0 - (t9 + t1)) * z + T_7;
    const double t11 = ((1.0 - (t1 + t2)) * x + (t3 - t4) * y + (t5 + t6) * z + T_5) / t10;
    const double t12 = ((t3 + t4) * x + (1.0 - (t9 + t2)) * y + (t7 - t8) * z + T_6) / t10;
    const double t13 = 2.0 * T_2;
    const double t14 = t11 / t10;
    const double t15 = z * t14;
    const double t16 = 2.0 * -(y * t14);
    const double t17 = z / t10;
    const double t18 = x * t14;
    const double t19 = 2.0 * (t17 - t18);
    const double t20 = y / t10;
    const double t21 = 2.0 * t20;
    const double t22 = t13 * (2.0 * t15) + T_1 * t16 + T_4 * t19 + T_3 * t21;
    const double t23 = 0.5 * T_1;
    const double t24 = 2.0 * (t18 + t17);
    const double t25 = 2.0 * -t20;
    const double t26 = T_2 * t16 + T_3 * t24 + T_4 * t25;
    const double t27 = 0.5 * T_2;
    const double t28 = 2.0 * T_3;
    const double t29 = x / t10;
    const double t30 = T_4 * t16 + T_1 * t24 + T_2 * t21 + t28 * (2.0 * (t15 - t29));
    const double t31 = 0.5 * T_4;
    const double t32 = 2.0 * T_4;
    const double t33 = T_3 * t16 + T_2 * t19 + T_1 * t25 + t32 * (2.0 * -t29);
    const double t34 = 0.5 * T_3;
    const double t35 = t12 / t10;
    const double t36 = z * t35;
    const double t37 = y * t35;
    const double t38 = 2.0 * -(t17 + t37);
    const double t39 = x * t35;
    const double t40 = 2.0 * -t39;
    const double t41 = 2.0 * t29;
    const double t42 = t13 * (2.0 * (t36 - t20)) + T_1 * t38 + T_4 * t40 + T_3 * t41;
    const double t43 = 2.0 * t39;
    const double t44 = T_2 * t38 + T_3 * t43 + T_4 * t41;
    const double t45 = 2.0 * (t17 - t37);
    const double t46 = T_4 * t45 + T_1 * t43 + T_2 * t41 + t28 * (2.0 * t36);
    const double t47 = T_3 * t45 + T_2 * t40 + T_1 * t41 + t32 * t25;
    const double t48 = 1.0 / t10;

    outputs[0] = t11 - u;
    outputs[1] = t12 - v;
    outputs[2] = t22 * t23 - t26 * t27 + t30 * t31 - t33 * t34;
    outputs[3] = t42 * t23 - t44 * t27 + t46 * t31 - t47 * t34;
    outputs[4] = t30 * t23 - (t26 * t34 + t22 * t31) + t33 * t27;
    outputs[5] = t46 * t23 - (t44 * t34 + t42 * t31) + t47 * t27;
    outputs[6] = t22 * t34 - t26 * t31 - t30 * t27 + t33 * t23;
    outputs[7] = t42 * t34 - t44 * t31 - t46 * t27 + t47 * t23;
    outputs[8] = t48;
    outputs[9] = -t14;
    outputs[10] = -t35;
    outputs[11] = t48;
}

/* d: stated noise. */
static void d_noise(const double *inputs, double *outputs)
{
    (void)inputs;

    outputs[0] = 0.002;
    outputs[1] = 0.002;
}

/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */
static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)
{
    long row;

    switch (kernel) {
    case 0:
        for (row = 0; row < rows; row++)
            d_values(inputs + row * 12, outputs + row * 2);
        break;
    case 1:
        for (row = 0; row < rows; row++)
            d_slopes(inputs + row * 12, outputs + row * 12);
        break;
    default:
        break;
    }
}

