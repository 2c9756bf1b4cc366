/* DAQP in the timed loop, by the C interface of its version 0.11.0; the functions are those of the installed library, and Python finds
 * them (solvers/kernel/daqp.py).
 *
 * The structures are those of its types.h and api.h; pointers to others are void, and the settings are Python's.
 */
#include "face_solvers.h"

#include <string.h>

typedef struct {
    int n, m, ms; /* variables; rows, of which the first ms are bounds */
    double *H, *f, *A, *bupper, *blower;
    int *sense;
    int *break_points, nh, problem_type;
} DAQPProblem;

typedef struct {
    DAQPProblem *qp;
    int n, m, ms;
    double *M, *dupper, *dlower, *Rinv, *v;
    int *sense;
    double *scaling, *RinvD;
    double *x, *xold;
    double *lam, *lam_star, *u, fval;
    double *L, *D;
    double *xldl, *zldl;
    int reuse_ind;
    int *WS, n_active;
    int iterations, sing_ind;
    int *prox_mask, n_prox;
    double soft_slack;
    void *settings;
    void *bnb;
    int outer_iter;
    void *hierarchy, *avi, *eq, *timer;
    double *Mu;
    double *rho_ls, *rho_us, *w_ls, *w_us;
    int state;
} DAQPWorkspace;

typedef struct {
    double *x, *lam, fval, soft_slack;
    int exitflag, iter, nodes;
    double solve_time, setup_time;
} DAQPResult;

enum { UPDATE_RINV = 1, UPDATE_V = 4, UPDATE_SENSE = 16 };
typedef int SetUp(DAQPProblem *problem, DAQPWorkspace *work, double *setup_time, int init_mask);
typedef int Update(int mask, DAQPWorkspace *work, DAQPProblem *problem);
typedef void Solve(DAQPResult *result, DAQPWorkspace *work);
typedef void Free(DAQPWorkspace *work);

/* Unlike other states it has pointers, so it stays where it is. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
    Update *update;
    Solve *solve;
    Free *free_workspace, *free_ldp;
    DAQPProblem problem;
    DAQPWorkspace work;
    DAQPResult result;
} Daqp;

enum { DAQP_KIND = 0x44515031, ADDRESSES = 6 };

FACE(daqp_bytes) { return finish_integer(a, (long long)sizeof(Daqp)); }

/* The arrays stay the caller's, and where they are; the addresses are those of four functions, in the order below, and of settings. */
FACE(daqp_setup)
{
    Daqp *const s = take_state(a, 0);
    const int64_t *const addresses = take_integers(a, ADDRESSES);
    double *const f = take_output(a, VECTOR, ANY_LENGTH);
    const int d = (int)taken_length(a);
    double *const H = take_output(a, d, d);
    double *const A = take_output(a, ANY_LENGTH, d);
    const int rows = (int)taken_length(a);
    double *const upper = take_output(a, VECTOR, d + rows);
    double *const lower = take_output(a, VECTOR, d + rows);
    int *const sense = take_ints(a, d + rows);
    double *const x = take_output(a, VECTOR, d);
    double *const lam = take_output(a, VECTOR, d + rows);
    const DAQPProblem problem = {d, d + rows, d, H, f, rows > 0 ? A : NULL, upper, lower, sense, NULL, 0, 0};
    need_bytes(a, 0, sizeof *s);
    if (!good(a)) {
        return finish(a, NULL);
    }
    memset(s, 0, sizeof *s);
    s->kind = DAQP_KIND;
    s->d = d;
    s->bytes = sizeof *s;
    s->update = (Update *)(intptr_t)addresses[1];
    s->solve = (Solve *)(intptr_t)addresses[2];
    s->free_workspace = (Free *)(intptr_t)addresses[3];
    s->free_ldp = (Free *)(intptr_t)addresses[4];
    s->work.settings = (void *)(intptr_t)addresses[5];
    s->problem = problem;
    s->result.x = x;
    s->result.lam = lam;
    return finish_integer(a, ((SetUp *)(intptr_t)addresses[0])(&s->problem, &s->work, NULL, 0));
}

FACE(daqp_free)
{
    Daqp *const s = take_state(a, DAQP_KIND);
    if (good(a)) {
        s->work.settings = NULL; /* which are Python's */
        s->free_workspace(&s->work);
        s->free_ldp(&s->work);
    }
    return finish_integer(a, 0);
}

static int update_sense(Daqp *s, int mask, int *sense)
{
    s->problem.sense = sense;
    return s->update(mask | UPDATE_SENSE, &s->work, &s->problem);
}

FACE(daqp_update)
{
    Daqp *const s = take_state(a, DAQP_KIND);
    const int renewed = (int)take_integer(a, 0, UPDATE_RINV + UPDATE_V);
    int *const sense = take_ints(a, good(a) ? s->problem.m : 0);
    return finish_integer(a, good(a) ? update_sense(s, renewed, sense) : 0);
}

static PyObject *result_of(const Daqp *s, Arguments *a)
{
    return finish(a, Py_BuildValue("(iid)", s->result.exitflag, s->result.iter, s->result.solve_time));
}

FACE(daqp_solve)
{
    Daqp *const s = take_state(a, DAQP_KIND);
    if (!good(a)) {
        return finish(a, NULL);
    }
    s->solve(&s->result, &s->work);
    return result_of(s, a);
}

FACE(daqp_result)
{
    const Daqp *const s = take_state(a, DAQP_KIND);
    return good(a) ? result_of(s, a) : finish(a, NULL);
}

typedef struct {
    const double *R, *l, *u; /* rows l <= R x <= u, the first d of R those of the identity */
    int rows, d;
    double tolerance;
} Rows;

/* DAQP's sense of each row at x, as in `cold` unless that is 0: 1 at the upper side, 3 at the lower one. */
static void mark_touched(const Rows *r, const double *x, const int *cold, int *sense)
{
    enum { AT_UPPER = 1, AT_LOWER = 3 };
    for (int i = 0; i < r->rows; ++i) {
        double value = i < r->d ? x[i] : 0;
        for (int j = 0; i >= r->d && j < r->d; ++j) {
            value += r->R[(size_t)i * (size_t)r->d + (size_t)j] * x[j];
        }
        sense[i] = cold[i] != 0 ? cold[i]
                   : value <= r->l[i] + r->tolerance ? AT_LOWER
                   : value >= r->u[i] - r->tolerance ? AT_UPPER
                                                     : 0;
    }
}

static Rows take_rows(Arguments *a)
{
    Rows r;
    r.R = take_array(a, ANY_LENGTH, ANY_LENGTH);
    r.rows = (int)taken_length(a);
    r.d = good(a) ? (int)a->views[a->arrays - 1].shape[1] : 0;
    r.l = take_array(a, VECTOR, r.rows);
    r.u = take_array(a, VECTOR, r.rows);
    r.tolerance = take_number(a);
    return r;
}

FACE(touched)
{
    const Rows r = take_rows(a);
    const double *const x = take_array(a, VECTOR, r.d);
    const int *const cold = take_ints(a, r.rows);
    int *const sense = take_ints(a, r.rows);
    if (good(a)) {
        mark_touched(&r, x, cold, sense);
    }
    return finish_integer(a, 0);
}

typedef struct {
    Daqp *s;
    Rows rows;
    int *cold, *sense;
} TimedDaqp;

/* The library reads the data where they are. */
static int update(void *solver, const double *P, const double *q)
{
    TimedDaqp *const t = solver;
    int flag;
    t->s->problem.H = (double *)P;
    t->s->problem.f = (double *)q;
    flag = update_sense(t->s, UPDATE_RINV | UPDATE_V, t->cold);
    return flag < 0 ? flag : OK;
}

static int solve(void *solver, const double *start, double *x)
{
    TimedDaqp *const t = solver;
    Daqp *const s = t->s;
    if (start != NULL) {
        mark_touched(&t->rows, start, t->cold, t->sense);
        update_sense(s, 0, t->sense);
    }
    s->solve(&s->result, &s->work);
    if (s->result.exitflag > 0) {
        memcpy(x, s->result.x, (size_t)s->d * sizeof(double));
    }
    return OK;
}

static TimedDaqp take_timed(Arguments *a)
{
    TimedDaqp t;
    t.s = take_state(a, DAQP_KIND);
    t.rows = take_rows(a);
    t.cold = take_ints(a, t.rows.rows);
    t.sense = take_ints(a, t.rows.rows);
    if (good(a) && (t.rows.rows != t.s->problem.m || t.rows.d != t.s->d)) {
        refuse(a, "the rows are not those of the problem set up");
    }
    return t;
}

FACE(time_daqp)
{
    TimedDaqp t = take_timed(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    double *const H = t.s->problem.H, *const f = t.s->problem.f;
    const TimedSolver solver = {&t, t.s->d, update, solve};
    PyObject *const found = finish_timed(a, &solver);
    t.s->problem.H = H; /* the data of the loop go when it ends */
    t.s->problem.f = f;
    return found;
}

/* P and q are H and f of the problem set up. */
FACE(daqp_follow)
{
    TimedDaqp t = take_timed(a);
    double *const last = take_output(a, VECTOR, t.rows.d);
    if (!good(a)) {
        return finish(a, NULL);
    }
    const TimedSolver solver = {&t, t.s->d, update, solve};
    return finish_followed(a, &solver, last);
}
