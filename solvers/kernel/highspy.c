/* HiGHS in the timed loop, by the C interface of the package highspy 1.15.1 (highs_c_api.h). */
#include "library.h"

enum { HIGHS_TRIANGULAR = 1, HIGHS_OPTIMAL = 7 };

typedef struct {
    Data data;
    void *highs;
    const double *time_limit; /* of one solve, in seconds */
    int *starts, *rows;       /* of the lower triangle in compressed columns */
    double *triangle, *column_dual, *row_value, *row_dual;
    int (*pass_hessian)(void *highs, int d, int count, int format, const int *starts, const int *rows,
                        const double *values);
    int (*change_costs)(void *highs, int first, int last, const double *cost);
    int (*set_number)(void *highs, const char *option, double value);
    double (*get_run_time)(const void *highs);
    int (*run)(void *highs);
    int (*get_status)(const void *highs);
    int (*get_solution)(const void *highs, double *x, double *column_dual, double *row_value, double *row_dual);
} State;

static int update(void *state, const double *P, const double *q)
{
    State *const s = state;
    const int d = (int)s->data.d;
    double *value = s->triangle;
    take_data(&s->data, P, q);
    for (int j = 0; j < d; value += d - j, ++j) {
        memcpy(value, P + (size_t)j * (size_t)(d + 1), (size_t)(d - j) * sizeof(double));
    }
    const int flag = s->pass_hessian(s->highs, d, d * (d + 1) / 2, HIGHS_TRIANGULAR, s->starts, s->rows, s->triangle);
    return flag < 0 ? flag : s->change_costs(s->highs, 0, d - 1, q) < 0 ? -1 : OK;
}

/* Each run starts cold. The library's clock accumulates over runs, so the limit is set relative to it. */
static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    (void)start;
    s->set_number(s->highs, "time_limit", s->get_run_time(s->highs) + *s->time_limit);
    s->run(s->highs);
    if (s->get_status(s->highs) == HIGHS_OPTIMAL) {
        s->get_solution(s->highs, x, s->column_dual, s->row_value, s->row_dual);
    }
    return OK;
}

LIBRARY(highspy)
