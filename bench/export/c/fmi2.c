/* The functions of FMI 2.0 for Co-Simulation. The types are declared from the text of the standard. */
#include <stddef.h>

#define FMI(name) fmi2##name
#define FMI_STATE(verb, rest) fmi2##verb##FMUstate##rest
#define FMI_DESERIALIZE fmi2DeSerializeFMUstate
#define FMI_SIZES
#define FIRST_VARIABLE REFERENCE

typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(void *environment, fmi2String name, fmi2Status, fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *environment, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    fmi2CallbackFunctions callbacks;
    char name[128];
} logger;

static void log_error(const logger *l, const char *why)
{
    if (l->callbacks.logger != NULL) {
        l->callbacks.logger(l->callbacks.componentEnvironment, l->name, fmi2Error, "logStatusError", "%s", why);
    }
}

#include "fmu.h"

EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }

EXPORTED void *fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                               const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    instance *const i = type == fmi2CoSimulation ? instantiated(guid) : NULL;
    if (i != NULL) {
        if (callbacks != NULL) {
            i->logger.callbacks = *callbacks;
        }
        strncpy(i->logger.name, name, sizeof i->logger.name - 1);
    }
    return i;
}

EXPORTED fmi2Status fmi2SetupExperiment(void *c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real now,
                                        fmi2Boolean has_stop, fmi2Real stop)
{
    return fmi2OK;
}

EXPORTED fmi2Status fmi2EnterInitializationMode(void *c) { return fmi2OK; }

EXPORTED fmi2Status fmi2GetReal(void *c, const fmi2ValueReference references[], size_t count, fmi2Real values[])
{
    return get_values(c, references, count, values);
}

EXPORTED fmi2Status fmi2SetReal(void *c, const fmi2ValueReference references[], size_t count, const fmi2Real values[])
{
    return set_values(c, references, count, values);
}

EXPORTED fmi2Status fmi2DoStep(void *c, fmi2Real now, fmi2Real interval, fmi2Boolean no_set_state)
{
    return do_step(c, now, interval);
}
EXPORTED fmi2Status fmi2CancelStep(void *c) { return refuse(c, "no step is under way"); }

/* No step is ever pending. */
#define NO_STATUS(name, type)                                                                                          \
    EXPORTED fmi2Status name(void *c, const fmi2StatusKind kind, type *value) { return fmi2Discard; }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetRealStatus, fmi2Real)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)

NONE_OF_TYPE(Integer)
NONE_OF_TYPE(Boolean)
NONE_OF_TYPE(String)
ABSENT(GetDirectionalDerivative, const fmi2ValueReference of[], size_t n, const fmi2ValueReference by[], size_t m,
       const fmi2Real seed[], fmi2Real values[])
ABSENT(SetRealInputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
       const fmi2Real values[])
ABSENT(GetRealOutputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer order[], fmi2Real values[])
