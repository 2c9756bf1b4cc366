/* A compensator as an FMU for Co-Simulation: the common part of FMI 2 and 3, which fmi2.c and fmi3.c include after
 * their own types.
 *
 * They define FMI(name), FMI_STATE(verb, rest), FMI_DESERIALIZE and FMI_SIZES (the version's spelling of names, and a
 * parameter that only FMI 3 has), FIRST_VARIABLE, the type `logger` and log_error. A step reads the reference at its
 * communication point and gives the drive at the next one.
 *
 * Source: Functional Mock-up Interface 2.0.4 and 3.0.1, fmi-standard.org. */
#include "piezo.h"
#include "piezo_fmu.h"

#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED
#endif

enum {
    TIME,
    REFERENCE,
    DRIVE,
    LOWEST,
    HIGHEST,
    RATE_LIMIT,
    MEASURED,
    GAIN,
    LAG,
    VARIABLES
}; /* value references; FMI 2 has none for time */

typedef struct {
    piezo_axis axis;
    double values[VARIABLES];
} fmu_state;

typedef struct {
    fmu_state state; /* first: a pointer to the instance is a pointer to its state */
    logger logger;
} instance;

static FMI(Status) refuse(void *c, const char *why)
{
    log_error(&((instance *)c)->logger, why);
    return FMI(Error);
}

EXPORTED FMI(Status) FMI(SetDebugLogging)(void *c, FMI(Boolean) on, size_t count, const FMI(String) categories[])
{
    return FMI(OK);
}
EXPORTED FMI(Status) FMI(Terminate)(void *c) { return FMI(OK); }
EXPORTED void FMI(FreeInstance)(void *c) { free(c); }

static void start(fmu_state *s)
{
    const double values[VARIABLES] = {0.0,        PIEZO_Y_CENTRE,       PIEZO_X_START,  PIEZO_LOW,
                                      PIEZO_HIGH, PIEZO_FMU_RATE_LIMIT, PIEZO_Y_CENTRE, PIEZO_FMU_INTEGRAL_GAIN,
                                      PIEZO_LAG_S};
    piezo_reset(&s->axis);
    memcpy(s->values, values, sizeof values);
}

/* A new instance, or NULL if the token is of another model or memory is exhausted. */
static instance *instantiated(FMI(String) its_token)
{
    instance *const i = strcmp(its_token, PIEZO_FMU_TOKEN) == 0 ? calloc(1, sizeof *i) : NULL;
    if (i != NULL) {
        start(&i->state);
    }
    return i;
}

EXPORTED FMI(Status) FMI(Reset)(void *c)
{
    start(c);
    return FMI(OK);
}

EXPORTED FMI(Status) FMI(ExitInitializationMode)(void *c)
{
    fmu_state *const s = c;
    const double rate = s->values[RATE_LIMIT];
    const int valid = rate >= 0.0
                      && piezo_set_limits(&s->axis, s->values[LOWEST], s->values[HIGHEST],
                                          rate > 0.0 ? rate * PIEZO_SAMPLE_TIME_S : INFINITY)
                             == PIEZO_OK
                      && piezo_set_integral_gain(&s->axis, s->values[GAIN]) == PIEZO_OK;
    return valid ? FMI(OK) : refuse(c, "the limits of the drive make no sense, or the integral gain is too large");
}

static int is_variable(long long reference) { return reference >= FIRST_VARIABLE && reference < VARIABLES; }

static FMI(Status) get_values(void *c, const FMI(ValueReference) references[], size_t count, double values[])
{
    for (size_t k = 0; k < count; ++k) {
        if (!is_variable(references[k])) {
            return refuse(c, "there is no such variable");
        }
        values[k] = ((fmu_state *)c)->values[references[k]];
    }
    return FMI(OK);
}

static FMI(Status) set_values(void *c, const FMI(ValueReference) references[], size_t count, const double values[])
{
    for (size_t k = 0; k < count; ++k) {
        if (!is_variable(references[k]) || references[k] == LAG) {
            return refuse(c, "there is no such variable");
        }
        ((fmu_state *)c)->values[references[k]] = values[k];
    }
    return FMI(OK);
}

/* Take the sampling steps of a communication interval, including the one at its start. */
static FMI(Status) do_step(void *c, double now, double interval)
{
    fmu_state *const s = c;
    const double steps = floor(interval / PIEZO_SAMPLE_TIME_S + 0.5);
    if (!(steps >= 1.0 && steps < 1e9 && fabs(interval - steps * PIEZO_SAMPLE_TIME_S) <= 1e-6 * PIEZO_SAMPLE_TIME_S)) {
        return refuse(c, "the communication interval is not a whole number of sampling periods");
    }
    for (long k = 0; k < (long)steps; ++k) {
        piezo_correct(&s->axis, s->values[MEASURED]);
        s->values[DRIVE] = piezo_step(&s->axis, s->values[REFERENCE]);
    }
    s->values[TIME] = now + interval;
    return FMI(OK);
}

/* Copy a state to *state, or to new memory for NULL. */
static FMI(Status) copy_state(void *c, const void *from, void **state)
{
    if (*state == NULL && (*state = malloc(sizeof(fmu_state))) == NULL) {
        return refuse(c, "there is no memory for the state");
    }
    memcpy(*state, from, sizeof(fmu_state));
    return FMI(OK);
}

EXPORTED FMI(Status) FMI_STATE(Get, )(void *c, void **state) { return copy_state(c, c, state); }

EXPORTED FMI(Status) FMI_STATE(Set, )(void *c, void *state)
{
    memcpy(c, state, sizeof(fmu_state));
    return FMI(OK);
}

EXPORTED FMI(Status) FMI_STATE(Free, )(void *c, void **state)
{
    free(*state);
    *state = NULL;
    return FMI(OK);
}

EXPORTED FMI(Status) FMI_STATE(Serialized, Size)(void *c, void *state, size_t *size)
{
    *size = sizeof(fmu_state);
    return FMI(OK);
}

EXPORTED FMI(Status) FMI_STATE(Serialize, )(void *c, void *state, FMI(Byte) bytes[], size_t size)
{
    if (size < sizeof(fmu_state)) {
        return refuse(c, "the buffer is too small for the state");
    }
    memcpy(bytes, state, sizeof(fmu_state));
    return FMI(OK);
}

EXPORTED FMI(Status) FMI_DESERIALIZE(void *c, const FMI(Byte) bytes[], size_t size, void **state)
{
    return size == sizeof(fmu_state) ? copy_state(c, bytes, state) : refuse(c, "the state cannot be read");
}

/* Functions that an FMU of real numbers without events, clocks and derivatives does not support. */
#define ABSENT(name, ...)                                                                                              \
    EXPORTED FMI(Status) FMI(name)(void *c, __VA_ARGS__) { return refuse(c, #name " is not supported"); }
#define NONE_OF_TYPE(kind)                                                                                             \
    EXPORTED FMI(Status)                                                                                               \
        FMI(Get##kind)(void *c, const FMI(ValueReference) r[], size_t count, FMI(kind) values[] FMI_SIZES)             \
    {                                                                                                                  \
        return count == 0 ? FMI(OK) : refuse(c, "there is no variable of type " #kind);                                \
    }                                                                                                                  \
    EXPORTED FMI(Status)                                                                                               \
        FMI(Set##kind)(void *c, const FMI(ValueReference) r[], size_t count, const FMI(kind) values[] FMI_SIZES)       \
    {                                                                                                                  \
        return count == 0 ? FMI(OK) : refuse(c, "there is no variable of type " #kind);                                \
    }
