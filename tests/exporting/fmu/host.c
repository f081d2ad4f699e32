/* Loads an FMU of FMI 3.0 for Co-Simulation: host LIBRARY TOKEN STEPS H NVARIABLES. Prints all variables at the end. */
#include <dlfcn.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#define TAKE(type, name, ...) type (*name)(__VA_ARGS__) = (type (*)(__VA_ARGS__))dlsym(library, #name)

static void say(void *environment, int status, const char *category, const char *text)
{
    (void)environment, (void)category;
    fprintf(stderr, "%d: %s\n", status, text);
}

int main(int count, char **given)
{
    void *const library = count == 6 ? dlopen(given[1], RTLD_NOW) : 0;
    if (!library) return fprintf(stderr, "%s\n", dlerror()), 1;
    TAKE(void *, fmi3InstantiateCoSimulation, const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
        void *, void *, void *);
    TAKE(int, fmi3EnterInitializationMode, void *, bool, double, double, bool, double);
    TAKE(int, fmi3ExitInitializationMode, void *);
    TAKE(int, fmi3DoStep, void *, double, double, bool, bool *, bool *, bool *, double *);
    TAKE(int, fmi3GetFloat64, void *, const unsigned *, size_t, double *, size_t);
    TAKE(void, fmi3FreeInstance, void *);
    void *const x = fmi3InstantiateCoSimulation("host", given[2], 0, 0, 0, 0, 0, 0, 0, 0, say, 0);
    if (!x || fmi3EnterInitializationMode(x, 0, 0.0, 0.0, 0, 0.0) || fmi3ExitInitializationMode(x)) return 2;
    const double h = atof(given[4]);
    double t = 0.0;
    for (int n = 0; n < atoi(given[3]); ++n) {
        bool event, terminate, early;
        if (fmi3DoStep(x, t, h, 1, &event, &terminate, &early, &t)) return 3;
    }
    const unsigned n = (unsigned)atoi(given[5]);
    for (unsigned variable = 0; variable < n; ++variable) {
        double value;
        if (fmi3GetFloat64(x, &variable, 1, &value, 1)) return 4;
        printf("%.17g\n", value);
    }
    fmi3FreeInstance(x);
    return 0;
}
