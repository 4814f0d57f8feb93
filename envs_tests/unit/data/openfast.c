#include <stdlib.h>
#include <string.h>
#include <stdio.h>
static int steps;
void FAST_AllocateTurbines(int *n, int *error, char *message) { *error = 0; }
void FAST_Sizes(int *i, char *file, int *fatal, int *count, double *dt, double *dt_out, double *end, int *error,
                char *message, char *names, double *a, double *b)
{
    const char *all[] = {NAMES};
    int k;
    *fatal = 4; *count = sizeof(all) / sizeof(*all); *dt = 0.0125; *error = 0;
    for (k = 0; k < *count; ++k) { memset(names + 20 * k, ' ', 20); memcpy(names + 20 * k, all[k], strlen(all[k])); }
}
void FAST_Start(int *i, int *n, int *m, double *in, double *out, int *error, char *message)
{
    memset(out, 0, *m * sizeof(double)); out[SPEED] = 12.0; *error = 0;
}
void FAST_Update(int *i, int *n, int *m, double *in, double *out, _Bool *over, int *error, char *message)
{
    *over = 0; *error = 0; out[SPEED] = 12.0; out[PITCH] = in[4] * 57.29577951308232; ++steps;
    if (steps > 16 && WAY == 1) { *error = 4; strcpy(message, "the mesh is   broken"); }
    if (steps > 16 && WAY == 2) { fputs("STOP in a subroutine\n", stdout); fflush(stdout); abort(); }
    if (steps > 16 && WAY == 3) exit(0);
}
