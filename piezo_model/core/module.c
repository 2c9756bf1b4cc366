/* The extension module piezo_model.core._core. */
#include "bank.h"
#include "module.h"

/* d unknowns, lanes of play (l) and of creep (c); t tiles, the last of number e. */
void measure_state(Arguments *a, const void *state)
{
    const ShapedHead *const head = state;
    const Shape s = head->shape;
    if (a->parsed > 1 && memcmp(&s, &((const ShapedHead *)a->values[0].memory)->shape, sizeof s) != 0) {
        refuse(a, "learner and compensator are of two shapes");
    }
    SIZE_OF(a, d) = unknowns(s);
    SIZE_OF(a, l) = lanes(s);
    SIZE_OF(a, c) = creep_lanes(s);
    if (head->state.kind == BANK_KIND) {
        SIZE_OF(a, t) = ((const BankHead *)state)->tiles;
        SIZE_OF(a, e) = SIZE_OF(a, t) - 1;
    }
}

extern PyMethodDef model_bindings[], basis_bindings[], compensator_bindings[], learner_bindings[], bank_bindings[],
    bouc_wen_bindings[], dense_bindings[], duhem_bindings[], maxwell_slip_bindings[], relay_preisach_bindings[];

PyObject *PyInit__core(void)
{
    PyMethodDef *const tables[] = {model_bindings,
                                   basis_bindings,
                                   compensator_bindings,
                                   learner_bindings,
                                   bank_bindings,
                                   bouc_wen_bindings,
                                   dense_bindings,
                                   duhem_bindings,
                                   maxwell_slip_bindings,
                                   relay_preisach_bindings,
                                   NULL};
    return make_module(tables);
}
