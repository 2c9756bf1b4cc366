/* The controllers and learners of a bank, eight actuators at once. */
#define CORE_TILE
#include "prefilter.c"
#include "compensator.c"
#include "controller.c"
#include "learner.c"
#include "offer.c"
#include "continuous.c"
#include "noise.c"
#include "optimum.c"
