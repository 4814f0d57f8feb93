#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
static int calls;
void DISCON(float *s, int *fail, const char *in, const char *out, char *message) {
    (void)out;
    calls = s[0] == 0.0f ? 1 : calls + 1;
    *fail = 0;
    message[0] = 0;
    s[41] = s[29];                          /* My of blade 1 of the blade that does not pitch */
    s[42] = s[68];                          /* its Mx */
    s[43] = s[2];                           /* interval */
    s[44] = s[1];                           /* time */
    s[46] = (float)calls;
    s[47] = s[59];                          /* azimuth */
    if (strstr(in, "dry.in") && calls > 2) { *fail = -1; strcpy(message, "the pump is dry"); }
    if (strstr(in, "noisy.in")) { *fail = 1; strcpy(message, "the pump is noisy"); }
    if (strstr(in, "nan.in") && calls > 2) s[46] = (float)INFINITY;
    if (strstr(in, "abort.in") && calls > 2) { fprintf(stderr, "now it comes\n"); abort(); }
    if (strstr(in, "memory.in")) {          /* elsewhere than in its readings */
        FILE *f = fopen(in, "a+");
        if (s[0] == 0.0f) fputc('x', f);
        fseek(f, 0, SEEK_END);
        s[46] = (float)ftell(f);
        fclose(f);
    }
}
void OTHER(float *s, int *fail, const char *in, const char *out, char *message) {
    (void)in; (void)out; *fail = 0; message[0] = 0; s[46] = 7.0f;
}
