/* Bladed library that hands OpenFAST the demands which another program in the same process has written.
   OpenFAST loads it as its controller and calls DISCON at every step; the program loads the same file and writes
   wt_gym_demands: pitch of blades 1 to 3 [rad], generator torque [N m], yaw rate [rad/s]. */

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

EXPORT double wt_gym_demands[5];

EXPORT void DISCON(float *swap, int *fail, const char *in_file, const char *out_name, char *message)
{
    int blade;
    (void)in_file;
    (void)out_name;
    for (blade = 0; blade < 3; ++blade)
        swap[41 + blade] = (float)wt_gym_demands[blade]; /* records 42 to 44 */
    swap[44] = (float)wt_gym_demands[0];                 /* 45: collective pitch */
    swap[46] = (float)wt_gym_demands[3];                 /* 47: generator torque */
    swap[47] = (float)wt_gym_demands[4];                 /* 48: yaw rate */
    swap[34] = 1.0f;                                     /* 35: generator on line */
    swap[54] = swap[55] = 0.0f;                          /* 55, 56: no override of pitch and torque */
    *fail = 0;
    message[0] = '\0';
}
