#include "bindings/tissue.h"
#include "bindings/python_model.h"
#include "tissue/contact_surface.h"
#include <algorithm>
#include <cmath>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

using Point = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;

void bind_contact(nb::module_& m) {
    nb::class_<ContactPatch>(m, "ContactPatch", "Nodes and weights of one contact; weights sum to 1.")
        .def_prop_ro_static("capacity", [](nb::handle) { return ContactPatch::capacity; })
        .def(
            "__init__",
            [](ContactPatch* self, In<int32_t, 1> nodes, In<double, 1> weights) {
                if (nodes.shape(0) != weights.shape(0) || nodes.shape(0) > ContactPatch::capacity)
                    throw std::invalid_argument("patch: as many weights as nodes, at most 256");
                new (self) ContactPatch();
                self->count = int(nodes.shape(0));
                std::copy_n(nodes.data(), self->count, self->node);
                std::copy_n(weights.data(), self->count, self->weight);
            },
            "nodes"_as_is, "weights"_as_is)
        .def_prop_ro(
            "nodes", [](const ContactPatch& p) { return copied(p.node, p.count); }, nb::rv_policy::automatic)
        .def_prop_ro(
            "weights", [](const ContactPatch& p) { return copied(p.weight, p.count); }, nb::rv_policy::automatic);

    nb::class_<SurfacePoint>(m, "SurfacePoint", "A point of the surface.")
        .def_ro("triangle", &SurfacePoint::triangle)
        .def_ro("distance", &SurfacePoint::distance, "mm from the point asked for")
        .def_prop_ro(
            "weights", [](const SurfacePoint& h) { return copied(h.weight, 3); }, nb::rv_policy::automatic,
            "barycentric, in the triangle")
        .def_prop_ro("point", [](const SurfacePoint& h) { return copied(h.point, 3); }, nb::rv_policy::automatic, "mm");

    nb::class_<ContactSurface>(m, "ContactSurface",
                               "The boundary of a mesh at rest: nearest points and contact patches.")
        .def(
            "__init__",
            [](ContactSurface* self, In<double, 2> nodes, In<int32_t, 2> triangles, In<uint8_t, 1> held) {
                const size_t count = nodes.shape(0);
                expect(nodes.shape(1) == 3 && triangles.shape(1) == 3 && held.shape(0) == count,
                       "surface: expected nodes (n, 3), triangles (m, 3), held (n,)");
                expect_numbers(triangles, count, "triangles: names a node that is not there");
                expect_finite(nodes, "nodes: not finite");
                new (self) ContactSurface(nodes.data(), int(nodes.shape(0)), triangles.data(), int(triangles.shape(0)),
                                          held.data());
            },
            "nodes"_as_is, "triangles"_as_is, "held"_as_is)
        .def(
            "carry",
            [](ContactSurface& s, In<int32_t, 2> carrier, In<double, 2> share, In<uint8_t, 1> held) {
                const size_t count = carrier.shape(0);
                expect(carrier.shape(1) == 4 && share.shape(0) == count && share.shape(1) == 4 &&
                           (s.node.empty() || *std::max_element(s.node.begin(), s.node.end()) < int(count)),
                       "carry: expected carrier (n, 4) and share (n, 4) for each of the surface's nodes");
                expect_numbers(carrier, held.shape(0), "carrier: names a node that is not there");
                expect_finite(share, "share: not finite");
                s.carry(carrier.data(), share.data(), int(count), held.data(), int(held.shape(0)));
            },
            "carrier"_as_is, "share"_as_is, "held"_as_is,
            "The nodes of a mesh, (n, 4), that move each of this surface's, and how much; held: (N,) of the mesh.")
        .def(
            "closest",
            [](const ContactSurface& s, Point p) {
                const SurfacePoint found = s.closest(p.data());
                const bool finite = std::all_of(p.data(), p.data() + 3, [](double x) { return std::isfinite(x); });
                expect(finite && found.triangle >= 0, "point: not finite, or the surface is empty");
                return found;
            },
            "point"_a)
        .def(
            "normal",
            [](const ContactSurface& s, const SurfacePoint& at) {
                expect(at.triangle < s.triangles(), "at: a point of another surface");
                double n[3];
                s.normal(at, n);
                return copied(n, 3);
            },
            "at"_a, "Outward unit normal, blended over the triangle.")
        .def(
            "patch",
            [](const ContactSurface& s, const SurfacePoint& at,
               double radius) -> std::variant<ContactPatch, std::string> {
                expect(at.triangle < s.triangles(), "at: a point of another surface");
                check_radius(radius);
                auto scratch = s.scratch();
                ContactPatch patch;
                switch (s.patch(at, radius, scratch, patch)) {
                case ContactSurface::PatchStatus::good:
                    return patch;
                case ContactSurface::PatchStatus::all_fixed:
                    return "held";
                default:
                    return "crowded";
                }
            },
            "at"_a, "radius"_a, "The smooth patch, or the word that says why there is none: held, crowded.")
        .def(
            "wide_patch",
            [](const ContactSurface& s, const SurfacePoint& at, double radius) {
                expect(at.triangle < s.triangles(), "at: a point of another surface");
                check_radius(radius);
                auto scratch = s.scratch();
                WidePatch patch(s.vertices());
                if (s.patch(at, radius, scratch, patch) != ContactSurface::PatchStatus::good) patch.count = 0;
                return nb::make_tuple(copied(patch.node.data(), patch.count), copied(patch.weight.data(), patch.count));
            },
            "at"_a, "radius"_a,
            nb::sig("def wide_patch(self, at: palpate._core.tissue.SurfacePoint, radius: float) -> "
                    "tuple[typing.Any, typing.Any]"),
            "Vertices and weights of the smooth patch, of any number; none if it is held.")
        .def(
            "patch_triangles",
            [](const ContactSurface& s, const SurfacePoint& at, double radius) {
                expect(at.triangle < s.triangles(), "at: a point of another surface");
                check_radius(radius);
                auto scratch = s.scratch();
                ContactPatch patch;
                s.patch(at, radius, scratch, patch);
                return copied(scratch.queue.data(), scratch.found);
            },
            "at"_a, "radius"_a, "Numbers of the triangles over which `patch` integrates.")
        .def_prop_ro(
            "nodes", [](const ContactSurface& s) { return copied(s.node); }, nb::rv_policy::automatic)
        .def_prop_ro(
            "normals", [](const ContactSurface& s) { return rows(s.normals); }, nb::rv_policy::automatic,
            "Outward unit normals at `nodes`.")
        .def_prop_ro("areas", [](const ContactSurface& s) { return copied(s.area); }, nb::rv_policy::automatic);
}

void bind_model(nb::module_& m) {
    nb::class_<ModelState>(m, "ModelState", "All that changes in a model: displacements, mm.")
        .def_prop_ro(
            "u",
            [](ModelState& s) {
                return nb::ndarray<nb::numpy, double, nb::ndim<2>, nb::c_contig>(s.u.data(), {s.u.size() / 3, 3});
            },
            nb::rv_policy::reference_internal);
    nb::class_<TissueModel>(m, "TissueModel", "A tissue that answers a push; immutable.")
        .def_prop_ro("nodes", &TissueModel::nodes)
        .def("make_state", &TissueModel::make_state, nb::keep_alive<0, 1>(), "A state at rest.")
        .def(
            "relax",
            [](const TissueModel& model, ModelState& state, const ContactPatch* patch, Point displacement, int sweeps) {
                check_owner(model, state);
                check_count(sweeps);
                if (patch) check_nodes(model, {*patch});
                double force[3] = {0, 0, 0}, moved[3];
                std::copy_n(displacement.data(), 3, moved);
                unlocked([&] { return model.relax(state, patch, patch ? 1 : 0, 0, moved, sweeps, force); });
                return copied(force, 3);
            },
            "state"_a, "patch"_a.none(), "displacement"_a, "sweeps"_a, "Force of the tissue on the tool, N.")
        .def(
            "relax_all",
            [](const TissueModel& model, ModelState& state, const std::vector<ContactPatch>& patches, int closed,
               In<double, 2> displacement, int sweeps) {
                check_owner(model, state);
                check_count(sweeps);
                check_nodes(model, patches);
                const size_t all = patches.size();
                if (displacement.shape(0) != all || displacement.shape(1) != 3 || closed < 0 || size_t(closed) > all ||
                    all > size_t(TissueModel::max_patches))
                    throw std::invalid_argument("displacement: (patches, 3); at most 4 patches, closed ones first");
                auto force = zeros<double>(all, 3), moved = zeros<double>(all, 3);
                std::copy_n(displacement.data(), 3 * all, moved.data());
                const bool good = unlocked([&] {
                    return model.relax(state, patches.data(), closed, int(all) - closed, moved.data(), sweeps,
                                       force.data());
                });
                expect(good, "patches: these cannot be told apart");
                return nb::make_tuple(force, moved);
            },
            "state"_a, "patches"_a, "closed"_a, "displacement"_as_is, "sweeps"_a,
            nb::sig("def relax_all(self, state: palpate._core.tissue.ModelState, patches: "
                    "list[palpate._core.tissue.ContactPatch], closed: int, displacement: object, "
                    "sweeps: int) -> tuple[typing.Any, typing.Any]"),
            "One tick of several tools, the first `closed` of which hold: forces on them (N), displacements (mm).")
        .def(
            "prefetch",
            [](const TissueModel& model, ModelState& state, const std::vector<ContactPatch>& patches) {
                check_owner(model, state);
                check_nodes(model, patches);
                model.prefetch(state, patches.data(), int(std::min<size_t>(patches.size(), TissueModel::max_patches)));
            },
            "state"_a, "patches"_a, "All patches that the next tick may bring: it depends on them by no bit.")
        .def(
            "displayed_displacement",
            [](const TissueModel& model, ModelState& state, In<int32_t, 1> nodes) {
                check_owner(model, state);
                expect_numbers(nodes, size_t(model.nodes()), "nodes: one not there");
                auto out = zeros<float>(nodes.shape(0), 3);
                nb::gil_scoped_release free;
                model.displayed_displacement(state, nodes.data(), int(nodes.shape(0)), out.data());
                return out;
            },
            "state"_a, "nodes"_as_is, "What a display is given of these nodes, (n, 3) mm.");
}

// Calls solve(patches, displacement (m, 3)) -> u (N, 3), force (m, 3), stiffness (3m, 3m), all float64.
bool call(const nb::callable& solve, int nodes, const ContactRequest& request, ContactAnswer& answer) {
    nb::gil_scoped_acquire interpreter;
    const size_t m = size_t(request.prescribed);
    try {
        auto displacement = zeros<double>(m, 3);
        std::copy_n(request.displacement, 3 * m, displacement.data());
        auto patches = std::vector<ContactPatch>(request.patch, request.patch + m);
        auto found = nb::cast<std::tuple<In<double, 2>, In<double, 2>, In<double, 2>>>(solve(patches, displacement));
        const auto& [u, force, stiffness] = found;
        if (u.size() != 3 * size_t(nodes) || force.size() != 3 * m || stiffness.size() != 9 * m * m)
            throw std::invalid_argument("tissue model: u (N, 3), force (m, 3), stiffness (3m, 3m)");
        std::copy_n(u.data(), u.size(), answer.u.begin());
        std::copy_n(force.data(), force.size(), answer.force);
        std::copy_n(stiffness.data(), stiffness.size(), answer.stiffness);
        return true;
    } catch (nb::python_error& error) {
        error.discard_as_unraisable("a tissue model in Python");
    } catch (const std::exception& error) {
        PyErr_SetString(PyExc_ValueError, error.what());
        nb::python_error().discard_as_unraisable("a tissue model in Python");
    }
    return false;
}

void bind_python_model(nb::module_& m) {
    nb::class_<PythonModel, TissueModel>(m, "PythonModel", "A model whose equilibrium a Python function computes.")
        .def(
            "__init__",
            [](PythonModel* self, int nodes, double rate, nb::callable solve) {
                expect(nodes >= 0 && nodes <= 1 << 28 && within(rate, 1e-3, 1e6),
                       "nodes: 0 or more; rate: 1e-3 to 1e6");
                new (self) PythonModel(nodes, rate, [solve, nodes](const ContactRequest& r, ContactAnswer& a) {
                    return call(solve, nodes, r, a);
                });
            },
            "nodes"_a, "rate"_a, "solve"_a,
            nb::sig("def __init__(self, nodes: int, rate: float, solve: typing.Callable[..., typing.Any]) -> None"));
}

} // namespace

void bind_tissue(nb::module_& m) {
    bind_contact(m);
    bind_model(m);
    bind_python_model(m);
}
