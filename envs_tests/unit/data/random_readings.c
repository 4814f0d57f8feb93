#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>
static float uniform(float low, float high) { return low + (high - low) * (float)rand() / (float)RAND_MAX; }
int main(int n, char **words) {
    static float swap[3500];
    char message[1025];
    int fail, worst = 0;
    (void)n;
    srand(1);
    for (int k = 0; k < 3000; k++) {
        const int blades[] = {3, 32, 33}, moments[] = {29, 30, 31, 68, 69, 70};
        swap[0] = k == 0 ? 0.0f : 1.0f; swap[1] = 0.05f * (float)k; swap[2] = 0.05f; swap[27] = 1.0f;
        swap[48] = 1025.0f; swap[49] = (float)strlen(words[1]) + 1.0f; swap[50] = (float)strlen(words[2]) + 1.0f;
        for (int b = 0; b < 3; b++) swap[blades[b]] = uniform(-0.1f, 1.6f);
        for (int b = 0; b < 6; b++) swap[moments[b]] = uniform(-3e7f, 3e7f);
        swap[19] = uniform(-10.0f, 200.0f); swap[20] = swap[19] / 97.0f; swap[14] = uniform(0.0f, 6e6f);
        swap[22] = uniform(0.0f, 5e4f); swap[23] = uniform(-7.0f, 7.0f); swap[26] = uniform(0.0f, 40.0f);
        swap[52] = uniform(-60.0f, 60.0f); swap[53] = uniform(-2.0f, 2.0f); swap[59] = uniform(-10.0f, 10.0f);
        swap[128] = 3500.0f; swap[2000] = 3.0f; swap[2001] = 1.0f; swap[2002] = 3.0f;
        for (int g = 0; g < 3; g++) {
            swap[2004 + g] = uniform(3.0f, 25.0f); swap[2007 + g] = -63.0f * (float)(g + 1); swap[2010 + g] = 0.0f;
        }
        swap[36] = uniform(-0.3f, 0.3f);
        if (k > 0 && k % 5 == 0) swap[2001 + rand() % 15] = k % 2 ? NAN : uniform(-1e9f, 1e9f);
        if (k > 0 && k % 7 == 0) swap[rand() % 75 + 3] = k % 2 ? NAN : INFINITY;
        DISCON(swap, &fail, words[1], words[2], message);
        if (fail < worst) worst = fail;
        for (int r = 41; r < 48; r++) if (!isfinite(swap[r])) { printf("not finite: %d in call %d\n", r, k); return 2; }
        if (k == 1500) {
            for (int status = -8; status >= -9; status--) {
                swap[0] = (float)status; DISCON(swap, &fail, words[1], words[2], message);
                if (fail != 0) { printf("%s\n", message); return 3; }
            }
        }
    }
    swap[0] = -1.0f;
    DISCON(swap, &fail, words[1], words[2], message);
    swap[0] = 0.0f;
    swap[48] = 20.0f;      /* a short message, a file that is not there */
    DISCON(swap, &fail, "nothing", words[2], message);
    if (fail != -1 || strlen(message) != 19) { printf("message '%s'\n", message); return 4; }
    return worst == 0 ? 0 : 5;
}
