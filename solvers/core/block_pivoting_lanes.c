/* Block principal pivoting of eight programs at once. */
#define CORE_TILE
#include "block_pivoting.c"
