/* The extension module piezo_model.core._core. */
#include "face_model.h"
#include "module.h"

static PyMethodDef methods[] = {
    METHOD(play, "play(x, r, z, out): play operators over samples; z moves on."),
    METHOD(creep, "creep(x, r, a, z, out): creep operators over samples; z moves on."),
    METHOD(dead_zone, "dead_zone(u, low, high, out): dead zones over samples."),
    METHOD(model_bytes, "model_bytes(n, zones, rates, offset): size of a model."),
    METHOD(model_setup, "model_setup(state, n, zones, rates, offset, constant): make a block a model; where its vectors stand."),
    METHOD(model_simulate, "model_simulate(state, play, creep, x, y): outputs for inputs; the states move on."),
    METHOD(basis_bytes, "basis_bytes(n, zones, rates, offset): size of a data basis."),
    METHOD(basis_setup, "basis_setup(state, n, zones, rates, offset, forgetting): make a block a data basis; where its vectors stand."),
    METHOD(basis_clear, "basis_clear(state): forget the rows."),
    METHOD(basis_update, "basis_update(state, x, y): count samples."),
    METHOD(basis_advance, "basis_advance(state, x): move the states on and count nothing."),
    METHOD(basis_gram, "basis_gram(state, rows, gram): the Gram matrix with the rows that wait; rows is room."),
    METHOD(basis_rows, "basis_rows(state, x, y, rows): the rows of samples; the states move on."),
    METHOD(compensator_bytes, "compensator_bytes(n, zones, rates, offset): size of a compensator."),
    METHOD(compensator_setup, "compensator_setup(state, n, zones, rates, offset): make a block a compensator; where its vectors stand."),
    METHOD(compensator_take, "compensator_take(state, weights): invert the model of these weights."),
    METHOD(compensator_hand_over, "compensator_hand_over(state, weights): the same without a bump."),
    METHOD(compensator_now, "compensator_now(state): the unit drive for the last reference at this moment."),
    METHOD(compensator_correct, "compensator_correct(state, y): integral action on the output that the last drive produced."),
    METHOD(compensator_step, "compensator_step(state, y_ref): the drive for one reference."),
    METHOD(compensator_run, "compensator_run(state, y_ref, x): drives for references."),
    METHOD(cyclic_bytes, "cyclic_bytes(n, zones, rates, offset): size of a learner in cycles."),
    METHOD(cyclic_setup, "cyclic_setup(state, n, zones, rates, offset, middle): make a block a learner; where its parts stand."),
    METHOD(cyclic_enter, "cyclic_enter(state, phase): begin a phase, 0 reset, 1 build, 2 learn."),
    METHOD(cyclic_observe, "cyclic_observe(state, compensator, y, x, first): learn; (samples done, what there is to tell)."),
    METHOD(cyclic_drive, "cyclic_drive(state, compensator, y, y_ref, x, first): drive and learn; the same."),
    METHOD(continuous_bytes, "continuous_bytes(n, zones, rates, offset): size of a learner without cycles."),
    METHOD(continuous_setup, "continuous_setup(state, n, zones, rates, offset, middle, min_slope, forgetting, proximal, most_exchanges): as cyclic_setup."),
    METHOD(continuous_begin_anew, "continuous_begin_anew(state, level): forget all but the weights in use."),
    METHOD(continuous_observe, "continuous_observe(state, compensator, y, x, first): learn; (samples done, what there is to tell)."),
    METHOD(continuous_drive, "continuous_drive(state, compensator, y, y_ref, x, first): drive and learn; the same."),
    METHOD(guard_judge, "guard_judge(memory, x, y, verdicts): which samples can be learned from."),
    METHOD(bank_bytes, "bank_bytes(n, zones, rates, offset, tiles): size of a bank."),
    METHOD(bank_room_bytes, "bank_room_bytes(n, zones, rates, offset): size of the room that each thread needs."),
    METHOD(bank_setup, "bank_setup(state, n, zones, rates, offset, tiles): make a block a bank; where its parts stand."),
    METHOD(bank_begin, "bank_begin(state, tile, which): take the weights that stand in a tile and learn anew."),
    METHOD(bank_run, "bank_run(state, y_ref, y, x, room, first, last): drives for references, learning from outputs."),
    METHOD(log_creep, "log_creep(u, a, z, u_previous, K): creep of an actuator."),
    METHOD(bouc_wen, "bouc_wen(u, A, beta, gamma, n, h, u_before, path): h along u."),
    METHOD(plays_and_creep, "plays_and_creep(u, r, w_H, w_K, a, z_play, z_creep, u_previous, total): their weighted sum along u."),
    METHOD(relay_lines, "relay_lines(u, r, c, sigma, gain, shift, z, total): sum over lines of relays along u."),
    METHOD(charge, "charge(u, spring, k, f, force, q, u_before, path): charge along u."),
    METHOD(deviation, "deviation(u, alpha, b, e, u_before, path): deviation along u."),
    METHOD(structure_response, "structure_response(f, F, s, z): positions while forces are held."),
    {NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {
    {{1, NULL}, NULL, 0, NULL}, "_core", "Model, data basis and compensator in C; see the headers in piezo_model/core.", -1, methods, NULL, NULL, NULL, NULL,
};

PyObject *PyInit__core(void) { return make_module(&definition); }
