#include <locale.h>
#include <stdio.h>
#include <string.h>
int main(int n, char **words) {
    char line[4096];
    if (n > 1 && setlocale(LC_ALL, words[1]) == NULL) return 2;
    if (n > 1 && snprintf(line, sizeof line, "%.1f", 0.5) && line[1] != ',') return 3;
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *end;
        double value;
        unsigned long long bits;
        line[strcspn(line, "\n")] = 0;
        value = read_number(line, &end);
        memcpy(&bits, &value, sizeof bits);
        printf("%016llx %d\n", bits, (int)(end - line));
    }
    return 0;
}
