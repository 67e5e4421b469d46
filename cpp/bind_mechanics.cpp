#include "bind.h"
#include "blocks.h"
#include "contact.h"
#include "springs.h"
#include <algorithm>
#include <cstring>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

using Point = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;
template <class T, int rank> using Out = nb::ndarray<nb::numpy, T, nb::ndim<rank>, nb::c_contig>;

template <class T> Out<T, 1> copied(const T* from, size_t n) {
    T* data = new T[n];
    std::copy_n(from, n, data);
    return Out<T, 1>(data, {n}, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<T*>(p); }));
}

template <class T> Out<T, 2> table(size_t rows, size_t columns) {
    T* data = new T[rows * columns]();
    return Out<T, 2>(data, {rows, columns}, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<T*>(p); }));
}

std::vector<uint8_t> flags(const In<uint8_t, 1>& held) { return {held.data(), held.data() + held.shape(0)}; }

void refuse_strangers(const Model& model, const State& state) {
    if (!model.owns(state)) throw std::invalid_argument("state: another model's; take one from this model's start()");
}

void refuse_nodes(const Model& model, const Patch& patch) {
    for (int k = 0; k < patch.count; k++)
        if (patch.node[k] < 0 || patch.node[k] >= model.nodes())
            throw std::invalid_argument("patch: names a node that the model does not have");
}

void bind_contact(nb::module_& m) {
    nb::class_<Patch>(m, "Patch", "Nodes and weights of one contact; weights sum to 1.")
        .def_prop_ro_static("capacity", [](nb::handle) { return Patch::capacity; })
        .def(
            "__init__",
            [](Patch* self, In<int32_t, 1> nodes, In<double, 1> weights) {
                if (nodes.shape(0) != weights.shape(0) || nodes.shape(0) > Patch::capacity)
                    throw std::invalid_argument("patch: as many weights as nodes, at most 256");
                new (self) Patch();
                self->count = int(nodes.shape(0));
                std::copy_n(nodes.data(), self->count, self->node);
                std::copy_n(weights.data(), self->count, self->weight);
            },
            "nodes"_a.noconvert(), "weights"_a.noconvert())
        .def_prop_ro(
            "nodes", [](const Patch& p) { return copied(p.node, p.count); }, nb::rv_policy::automatic)
        .def_prop_ro("weights", [](const Patch& p) { return copied(p.weight, p.count); }, nb::rv_policy::automatic);

    nb::class_<Hit>(m, "Hit", "A point of the surface.")
        .def_ro("triangle", &Hit::triangle)
        .def_ro("distance", &Hit::distance, "mm from the point asked for")
        .def_prop_ro(
            "weights", [](const Hit& h) { return copied(h.weight, 3); }, nb::rv_policy::automatic,
            "barycentric, in the triangle")
        .def_prop_ro("point", [](const Hit& h) { return copied(h.point, 3); }, nb::rv_policy::automatic, "mm");

    nb::class_<Surface>(m, "Surface", "The boundary of a mesh at rest: nearest points and contact patches.")
        .def(
            "__init__",
            [](Surface* self, In<double, 2> nodes, In<int32_t, 2> triangles, In<uint8_t, 1> held) {
                new (self)
                    Surface(nodes.data(), int(nodes.shape(0)), triangles.data(), int(triangles.shape(0)), held.data());
            },
            "nodes"_a.noconvert(), "triangles"_a.noconvert(), "held"_a.noconvert())
        .def(
            "closest", [](const Surface& s, Point p) { return s.closest(p.data()); }, "point"_a)
        .def(
            "normal",
            [](const Surface& s, const Hit& at) {
                double n[3];
                s.normal(at, n);
                return copied(n, 3);
            },
            "at"_a, "Outward unit normal, blended over the triangle.")
        .def(
            "patch",
            [](const Surface& s, const Hit& at, double radius) -> std::variant<Patch, std::string> {
                auto scratch = s.scratch();
                Patch patch;
                switch (s.patch(at, radius, scratch, patch)) {
                case Surface::Contact::good:
                    return patch;
                case Surface::Contact::held:
                    return "held";
                default:
                    return "crowded";
                }
            },
            "at"_a, "radius"_a, "The smooth patch, or the word that says why there is none: held, crowded.")
        .def_prop_ro(
            "nodes", [](const Surface& s) { return copied(s.node.data(), s.node.size()); }, nb::rv_policy::automatic)
        .def_prop_ro(
            "areas", [](const Surface& s) { return copied(s.area.data(), s.area.size()); }, nb::rv_policy::automatic);
}

void bind_ring_models(nb::module_& m) {
    nb::class_<State>(m, "State", "All that changes in a model: displacements, mm.")
        .def_prop_ro(
            "u",
            [](State& s) {
                return nb::ndarray<nb::numpy, double, nb::ndim<2>, nb::c_contig>(s.u.data(), {s.u.size() / 3, 3});
            },
            nb::rv_policy::reference_internal);
    nb::class_<Model>(m, "Model", "A tissue that answers a push; immutable.")
        .def_prop_ro("nodes", &Model::nodes)
        .def("start", &Model::start, "A state at rest.")
        .def(
            "advance",
            [](const Model& model, State& state, const Patch* patch, Point displacement, int sweeps) {
                refuse_strangers(model, state);
                if (patch) refuse_nodes(model, *patch);
                double force[3] = {0, 0, 0}, moved[3];
                {
                    nb::gil_scoped_release free;
                    std::copy_n(displacement.data(), 3, moved);
                    model.advance(state, patch, patch ? 1 : 0, 0, moved, sweeps, force);
                }
                return copied(force, 3);
            },
            "state"_a, "patch"_a.none(), "displacement"_a, "sweeps"_a, "Force of the tissue on the tool, N.")
        .def(
            "advance_all",
            [](const Model& model, State& state, const std::vector<Patch>& patches, int closed,
               In<double, 2> displacement, int sweeps) {
                refuse_strangers(model, state);
                for (const Patch& patch : patches) refuse_nodes(model, patch);
                const size_t all = patches.size();
                if (displacement.shape(0) != all || displacement.shape(1) != 3 || closed < 0 || size_t(closed) > all ||
                    all > size_t(most_tools))
                    throw std::invalid_argument("displacement: (patches, 3); at most 4 patches, closed ones first");
                auto force = table<double>(all, 3), moved = table<double>(all, 3);
                std::copy_n(displacement.data(), 3 * all, moved.data());
                bool good;
                {
                    nb::gil_scoped_release free;
                    good = model.advance(state, patches.data(), closed, int(all) - closed, moved.data(), sweeps,
                                         force.data());
                }
                if (!good) throw std::invalid_argument("patches: these cannot be told apart");
                return nb::make_tuple(force, moved);
            },
            "state"_a, "patches"_a, "closed"_a, "displacement"_a.noconvert(), "sweeps"_a,
            nb::sig("def advance_all(self, state: State, patches: list[Patch], closed: int, displacement: object, "
                    "sweeps: int) -> tuple[typing.Any, typing.Any]"),
            "One tick of several tools, the first `closed` of which hold: forces on them (N), displacements (mm).")
        .def(
            "expect",
            [](const Model& model, State& state, const std::vector<Patch>& patches) {
                refuse_strangers(model, state);
                for (const Patch& patch : patches) refuse_nodes(model, patch);
                model.expect(state, patches.data(), int(std::min<size_t>(patches.size(), most_tools)));
            },
            "state"_a, "patches"_a, "All patches that the next tick may bring: it depends on them by no bit.")
        .def(
            "show",
            [](const Model& model, State& state, In<int32_t, 1> nodes) {
                refuse_strangers(model, state);
                for (size_t k = 0; k < nodes.shape(0); k++)
                    if (nodes(k) < 0 || nodes(k) >= model.nodes()) throw std::invalid_argument("nodes: one not there");
                auto out = table<float>(nodes.shape(0), 3);
                {
                    nb::gil_scoped_release free;
                    model.show(state, nodes.data(), int(nodes.shape(0)), out.data());
                }
                return out;
            },
            "state"_a, "nodes"_a.noconvert(), "What a display is given of these nodes, (n, 3) mm.");
    nb::class_<RingModel, Model>(m, "RingModel")
        .def(
            "solve",
            [](const RingModel& model, State& state, const std::vector<Patch>& patches, In<double, 2> displacement,
               int sweeps) -> std::optional<Out<double, 2>> {
                refuse_strangers(model, state);
                for (const Patch& patch : patches) refuse_nodes(model, patch);
                if (displacement.shape(0) != patches.size() || displacement.shape(1) != 3)
                    throw std::invalid_argument("displacement: expected shape (contacts, 3)");
                auto force = table<double>(patches.size(), 3);
                bool done;
                {
                    nb::gil_scoped_release free;
                    done = model.solve(state, patches.data(), int(patches.size()), displacement.data(), sweeps,
                                       force.data());
                }
                return done ? std::optional(force) : std::nullopt;
            },
            "state"_a, "patches"_a, "displacement"_a.noconvert(), "sweeps"_a,
            "Forces of the tissue on the tools, (contacts, 3) N; None for contacts that cannot be held together.")
        .def(
            "internal_force",
            [](const RingModel& model, const State& state) {
                refuse_strangers(model, state);
                auto out = table<double>(model.nodes(), 3);
                model.internal_force(state, out.data());
                return out;
            },
            "state"_a, "(nodes, 3) N that each node needs from outside to stay where it is.")
        .def(
            "balance",
            [](const RingModel& model, const State& state, In<double, 2> force) {
                refuse_strangers(model, state);
                if (force.shape(0) < size_t(static_cast<const RingState&>(state).contacts) || force.shape(1) != 3)
                    throw std::invalid_argument("force: expected shape (contacts, 3)");
                std::pair<double, double> out;
                model.balance(state, force.data(), &out.first, &out.second);
                return out;
            },
            "state"_a, "force"_a.noconvert(), "Energy u'Ku/2 and residual r'M^-1 r/2, N mm.")
        .def(
            "residual",
            [](const RingModel& model, const State& state, In<double, 2> force) {
                refuse_strangers(model, state);
                if (force.shape(0) < size_t(static_cast<const RingState&>(state).contacts) || force.shape(1) != 3)
                    throw std::invalid_argument("force: expected shape (contacts, 3)");
                auto out = table<double>(model.nodes(), 3);
                model.residual(state, force.data(), out.data());
                return out;
            },
            "state"_a, "force"_a.noconvert(), "(nodes, 3) N out of balance at the nodes that may move.")
        .def(
            "rows",
            [](const RingModel& model, const State& state) {
                refuse_strangers(model, state);
                const auto& row = static_cast<const RingState&>(state).rings.row;
                return copied(row.data(), row.size());
            },
            "state"_a, "Ring of each node, 1 at the contact.")
        .def_ro_static("most_contacts", &RingModel::most_contacts);
    nb::class_<Blocks, RingModel>(m, "Blocks", "3x3 blocks of a finite-element operator, relaxed ring by ring.")
        .def(
            "__init__",
            [](Blocks* self, In<int32_t, 1> start, In<int32_t, 1> column, In<double, 3> block, In<uint8_t, 1> held,
               double relaxation, std::optional<In<double, 2>> shape, std::optional<In<double, 2>> load) {
                const size_t nodes = held.shape(0), size = 3 * nodes * Modes::count;
                if (shape.has_value() != load.has_value() || (shape && (shape->size() != size || load->size() != size)))
                    throw std::invalid_argument("modes: expected shape and load of (3 nodes, 12), or none");
                new (self) Blocks(start.data(), column.data(), block.data(), int(nodes), flags(held), relaxation,
                                  shape ? Modes(shape->data(), load->data(), int(nodes)) : Modes());
            },
            "start"_a.noconvert(), "column"_a.noconvert(), "block"_a.noconvert(), "held"_a.noconvert(), "relaxation"_a,
            "shape"_a = nb::none(), "load"_a = nb::none())
        .def_ro_static("modes", &Modes::count);
    nb::class_<Springs, RingModel>(m, "Springs", "Home and edge springs, relaxed ring by ring.")
        .def(
            "__init__",
            [](Springs* self, In<int32_t, 1> start, In<int32_t, 1> column, In<double, 1> stiffness,
               In<double, 2> position, In<uint8_t, 1> held, const std::string& law, double parameter, bool by_distance,
               double edge, double relaxation, bool imposed) {
                SpringLaw::Kind kind = law == "uniform"  ? SpringLaw::Kind::uniform
                                       : law == "linear" ? SpringLaw::Kind::linear
                                                         : SpringLaw::Kind::exponential;
                new (self) Springs(start.data(), column.data(), stiffness.data(), position.data(), int(held.shape(0)),
                                   flags(held), {kind, parameter, by_distance, edge}, relaxation, imposed);
            },
            "start"_a.noconvert(), "column"_a.noconvert(), "stiffness"_a.noconvert(), "position"_a.noconvert(),
            "held"_a.noconvert(), "law"_a, "parameter"_a, "by_distance"_a, "edge"_a, "relaxation"_a, "imposed"_a)
        .def(
            "home",
            [](const Springs& model, const State& state) {
                refuse_strangers(model, state);
                const auto& home = static_cast<const RingState&>(state).home;
                return copied(home.data(), home.size());
            },
            "state"_a, "Home spring of each node, N/mm.")
        .def(
            "contraction",
            [](const Springs& model, const State& state) {
                refuse_strangers(model, state);
                return model.contraction(state);
            },
            "state"_a, "1 - rho: least eigenvalue bound of diag(K)^-1 K.");
}

} // namespace

void bind_mechanics(nb::module_& m) {
    bind_contact(m);
    bind_ring_models(m);
}
