/* The functions of FMI 3.0 for Co-Simulation. The types are declared from the text of the standard. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FMI(name) fmi3##name
#define FMI_STATE(verb, rest) fmi3##verb##FMUState##rest
#define FMI_DESERIALIZE fmi3DeserializeFMUState
#define FMI_SIZES , size_t sizes
#define FIRST_VARIABLE TIME

typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3DependencyKind, fmi3IntervalQualifier; /* unused enumerations */
typedef void (*fmi3LogMessageCallback)(void *environment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3Callback)(void); /* any callback that is never called */

typedef struct {
    void *environment;
    fmi3LogMessageCallback log;
} logger;

static void log_error(const logger *l, const char *why)
{
    if (l->log != NULL) {
        l->log(l->environment, fmi3Error, "logStatusError", why);
    }
}

#include "fmu.h"

EXPORTED const char *fmi3GetVersion(void) { return "3.0"; }

EXPORTED void *fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                           fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                           const fmi3ValueReference required[], size_t count, void *environment,
                                           fmi3LogMessageCallback log, fmi3Callback update)
{
    instance *const i = instantiated(token);
    if (i != NULL) {
        i->logger = (logger){environment, log};
    }
    return i;
}

EXPORTED void *fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                            fmi3Boolean visible, fmi3Boolean logging, void *environment,
                                            fmi3LogMessageCallback log)
{
    return NULL;
}

EXPORTED void *fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging, void *environment,
                                                 fmi3LogMessageCallback log, fmi3Callback update, fmi3Callback lock,
                                                 fmi3Callback unlock)
{
    return NULL;
}

EXPORTED fmi3Status fmi3EnterInitializationMode(void *c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                fmi3Float64 now, fmi3Boolean has_stop, fmi3Float64 stop)
{
    ((fmu_state *)c)->values[TIME] = now;
    return fmi3OK;
}

EXPORTED fmi3Status fmi3GetFloat64(void *c, const fmi3ValueReference references[], size_t count, fmi3Float64 values[],
                                   size_t sizes)
{
    return count <= sizes ? get_values(c, references, count, values)
                          : refuse(c, "there are fewer values than variables");
}

EXPORTED fmi3Status fmi3SetFloat64(void *c, const fmi3ValueReference references[], size_t count,
                                   const fmi3Float64 values[], size_t sizes)
{
    return count <= sizes ? set_values(c, references, count, values)
                          : refuse(c, "there are fewer values than variables");
}

EXPORTED fmi3Status fmi3DoStep(void *c, fmi3Float64 now, fmi3Float64 interval, fmi3Boolean no_set_state,
                               fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    const fmi3Status status = do_step(c, now, interval);
    *event = *terminate = *early = false;
    *last = status == fmi3OK ? now + interval : now;
    return status;
}

NONE_OF_TYPE(Float32)
NONE_OF_TYPE(Int8)
NONE_OF_TYPE(UInt8)
NONE_OF_TYPE(Int16)
NONE_OF_TYPE(UInt16)
NONE_OF_TYPE(Int32)
NONE_OF_TYPE(UInt32)
NONE_OF_TYPE(Int64)
NONE_OF_TYPE(UInt64)
NONE_OF_TYPE(Boolean)
NONE_OF_TYPE(String)
#define ABSENT_ALONE(name)                                                                                             \
    EXPORTED fmi3Status fmi3##name(void *c) { return refuse(c, #name " is not supported"); }
ABSENT_ALONE(EnterEventMode)
ABSENT_ALONE(EnterStepMode)
ABSENT_ALONE(EnterContinuousTimeMode)
ABSENT_ALONE(EnterConfigurationMode)
ABSENT_ALONE(ExitConfigurationMode)
ABSENT_ALONE(EvaluateDiscreteStates)
ABSENT(GetBinary, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary values[], size_t count)
ABSENT(SetBinary, const fmi3ValueReference r[], size_t n, const size_t sizes[], const fmi3Binary values[], size_t count)
ABSENT(GetClock, const fmi3ValueReference r[], size_t n, fmi3Clock values[])
ABSENT(SetClock, const fmi3ValueReference r[], size_t n, const fmi3Clock values[])
ABSENT(GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *n)
ABSENT(GetVariableDependencies, fmi3ValueReference r, size_t of[], fmi3ValueReference by[], size_t by_elements[],
       fmi3DependencyKind kinds[], size_t n)
ABSENT(GetDirectionalDerivative, const fmi3ValueReference of[], size_t n, const fmi3ValueReference by[], size_t m,
       const fmi3Float64 seed[], size_t seeds, fmi3Float64 values[], size_t count)
ABSENT(GetAdjointDerivative, const fmi3ValueReference of[], size_t n, const fmi3ValueReference by[], size_t m,
       const fmi3Float64 seed[], size_t seeds, fmi3Float64 values[], size_t count)
ABSENT(GetIntervalDecimal, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], fmi3IntervalQualifier q[])
ABSENT(GetIntervalFraction, const fmi3ValueReference r[], size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
       fmi3IntervalQualifier q[])
ABSENT(GetShiftDecimal, const fmi3ValueReference r[], size_t n, fmi3Float64 shifts[])
ABSENT(GetShiftFraction, const fmi3ValueReference r[], size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
ABSENT(SetIntervalDecimal, const fmi3ValueReference r[], size_t n, const fmi3Float64 intervals[])
ABSENT(SetIntervalFraction, const fmi3ValueReference r[], size_t n, const fmi3UInt64 counters[],
       const fmi3UInt64 resolutions[])
ABSENT(SetShiftDecimal, const fmi3ValueReference r[], size_t n, const fmi3Float64 shifts[])
ABSENT(SetShiftFraction, const fmi3ValueReference r[], size_t n, const fmi3UInt64 counters[],
       const fmi3UInt64 resolutions[])
ABSENT(UpdateDiscreteStates, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *states,
       fmi3Boolean *next_defined, fmi3Float64 *next)
ABSENT(GetOutputDerivatives, const fmi3ValueReference r[], size_t n, const fmi3Int32 orders[], fmi3Float64 values[],
       size_t count)
ABSENT(ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
ABSENT(CompletedIntegratorStep, fmi3Boolean no_set_state, fmi3Boolean *event, fmi3Boolean *terminate)
ABSENT(SetTime, fmi3Float64 time)
ABSENT(SetContinuousStates, const fmi3Float64 states[], size_t n)
ABSENT(GetContinuousStateDerivatives, fmi3Float64 derivatives[], size_t n)
ABSENT(GetEventIndicators, fmi3Float64 indicators[], size_t n)
ABSENT(GetContinuousStates, fmi3Float64 states[], size_t n)
ABSENT(GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t n)
ABSENT(GetNumberOfEventIndicators, size_t *n)
ABSENT(GetNumberOfContinuousStates, size_t *n)
