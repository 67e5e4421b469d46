#include "bindings/module.h"
#include "compliance/compliance_model.h"
#include <algorithm>
#include <nanobind/stl/vector.h>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

FactoredStiffness elastic(const SparseCholesky& factor, In<int32_t, 1> free, In<int32_t, 1> vertices,
                          In<double, 2> nodes) {
    if (!factor.positive) throw std::invalid_argument("ComplianceModel: the stiffness is not positive definite");
    const int count = int(free.shape(0));
    expect_vectors(nodes, free.size(), "nodes: expected shape (nodes, 3)");
    expect_finite(nodes, "nodes: not finite");
    const std::vector<int> free_index = listed(free), named = listed(vertices);
    for (int f : free_index)
        if (f < -1 || f >= factor.tree.nodes()) throw std::invalid_argument("free: a number that the factor lacks");
    std::vector<uint8_t> seen(count, 0);
    for (int node : named)
        if (node < 0 || node >= count || free_index[node] < 0 || seen[node]++)
            throw std::invalid_argument("vertices: each a free node, named once");
    return factored_stiffness(factor.tree, &factor, factor.rounded(), free_index, named, nodes.data());
}

RelaxationSpectrum spectrum(In<double, 2> relaxation) {
    expect(relaxation.shape(1) == 2 && relaxation.shape(0) <= RelaxationSpectrum::max_terms,
           "relaxation: expected shape (terms, 2), at most 6 terms");
    std::vector<std::array<double, 2>> series;
    double sum = 0;
    for (size_t k = 0; k < relaxation.shape(0); k++) {
        expect(relaxation(k, 0) > 0 && relaxation(k, 0) < 1, "relaxation: a share is more than 0 and less than 1");
        expect(within(relaxation(k, 1), 1e-3, 1e6), "relaxation: times are 0.001 to 1000000 s");
        sum += relaxation(k, 0);
        series.push_back({relaxation(k, 0), relaxation(k, 1)});
    }
    expect(sum < 0.999, "relaxation: some stiffness must be left");
    return RelaxationSpectrum(series);
}

LoadRecursion creep(In<double, 1> times, In<double, 2> mix, size_t samples) {
    expect(within(double(times.size()), 1.0, double(LoadRecursion::max_fields)), "times: 1 to 7");
    expect(within(double(samples), 2.0, double(LoadRecursion::max_samples)), "factors: 2 to 8");
    expect(mix.shape(0) == times.size() && mix.shape(1) == samples, "mix: expected shape (times, samples)");
    for (size_t k = 0; k < times.size(); k++) {
        expect(within(times(k), 1e-3, 1e9), "times: 0.001 to 1000000000 s");
        for (size_t s = 0; s < samples; s++) expect(within(mix(k, s), -1e6, 1e6), "mix: -1000000 to 1000000");
    }
    return LoadRecursion::of(listed(times), std::vector<double>(mix.data(), mix.data() + mix.size()));
}

std::vector<int> vertex_list(const ComplianceState& s, In<int32_t, 1> vertices) {
    expect_numbers(vertices, s.field.size() / 3, "vertices: one that is not there");
    return listed(vertices);
}

template <class F> void in_batches(const std::vector<int>& all, F make) {
    for (size_t k = 0; k < all.size(); k += GreensFunctions::batch)
        make(&all[k], int(std::min<size_t>(GreensFunctions::batch, all.size() - k)));
}

// W and K^-1 N come as `count` numbers a row, and are kept as rows of whole cache lines.
AlignedBuffer padded(const double* from, size_t rows, int count, int stride) {
    AlignedBuffer out(rows * stride);
    for (size_t r = 0; r < rows; r++)
        for (int k = 0; k < count; k++) out[r * stride + k] = float(from[r * count + k]);
    return out;
}

void check_gaps(const GapConstraints& gaps, size_t vertices, int free_nodes) {
    expect(gaps.response.size() == 3 * vertices * gaps.stride, "gaps: of other vertices");
    for (int node : gaps.node) expect(node < free_nodes, "gaps: a node that the factor lacks");
}

} // namespace

void bind_compliance(nb::module_& m) {
    nb::class_<ComplianceState, ModelState>(m, "ComplianceState",
                                            "Tables that grow where they are needed, and a force.")
        .def_ro("stale", &ComplianceState::stale, "The last answer lacked tables.")
        .def_prop_ro(
            "bytes",
            [](const ComplianceState& s) {
                size_t sum = 0;
                for (const GreensFunctions* greens : s.greens) sum += greens->bytes.load();
                return sum;
            },
            "Of the tables.")
        .def_prop_ro(
            "made",
            [](const ComplianceState& s) {
                int64_t blocks = 0, columns = 0, evicted = 0;
                for (const GreensFunctions* greens : s.greens)
                    blocks += greens->blocks_computed, columns += greens->columns_computed, evicted += greens->evicted;
                return nb::make_tuple(blocks, columns, evicted);
            },
            nb::sig("def made(self, /) -> tuple[int, int, int]"), "Nodes' blocks and columns made, and evictions.")
        .def(
            "make_near",
            [](ComplianceState& s, In<int32_t, 1> vertices, double reach) {
                expect(within(reach, 0.0, 1e9), "reach: 0 mm or more");
                nb::gil_scoped_release free;
                in_batches(vertex_list(s, vertices), [&](const int* v, int n) {
                    for (GreensFunctions* greens : s.greens) greens->compute_blocks(v, n, reach);
                });
            },
            "vertices"_as_is, "reach"_a, "Blocks of these vertices with all others within `reach` mm.")
        .def(
            "make_columns",
            [](ComplianceState& s, In<int32_t, 1> vertices) {
                nb::gil_scoped_release free;
                in_batches(vertex_list(s, vertices), [&](const int* v, int n) {
                    for (GreensFunctions* greens : s.greens) greens->compute_columns(v, n);
                });
            },
            "vertices"_as_is, "Columns of these vertices, for displays.")
        .def(
            "has_columns",
            [](const ComplianceState& s, In<int32_t, 1> vertices) {
                bool all = true;
                for (int v : vertex_list(s, vertices))
                    for (const GreensFunctions* greens : s.greens) all = all && greens->columns(v);
                return all;
            },
            "vertices"_as_is);
    nb::class_<VibrationModes>(m, "VibrationModes", "The lowest modes of a body, by which it has inertia.")
        .def(
            "__init__",
            [](VibrationModes* self, In<double, 1> frequency, In<float, 3> shape, double damping, double lag,
               In<double, 2> relaxation) {
                expect(frequency.size() <= size_t(VibrationModes::most), "frequencies: at most 256");
                for (size_t m = 0; m < frequency.shape(0); m++)
                    expect(within(frequency(m), 1e-3, 1e6), "frequencies: 0.001 to 1000000 rad/s");
                expect(shape.shape(1) == frequency.shape(0) && shape.shape(2) == 3,
                       "shapes: expected shape (nodes, modes, 3)");
                expect_finite(shape, "shapes: not finite");
                expect(within(damping, 0.0, 0.99) && within(lag, 1e-5, 1.0), "damping: 0 to 0.99; lag: 0.00001 to 1 s");
                new (self)
                    VibrationModes(listed(frequency), std::vector<float>(shape.data(), shape.data() + shape.size()),
                                   damping, lag, spectrum(relaxation));
            },
            "frequencies"_as_is, "shapes"_as_is, "damping"_a, "lag"_a, "relaxation"_as_is,
            "frequencies: (modes) rad/s. shapes: (nodes, modes, 3) mm for an amplitude of 1 root of N mm s^2. damping: "
            "ratio. lag: s. relaxation: as of ComplianceModel.");
    nb::class_<GapConstraints>(m, "GapConstraints", "Surfaces of a body that may meet.")
        .def(
            "__init__",
            [](GapConstraints* self, In<double, 1> rest, In<double, 1> give, double friction, In<double, 2> between,
               In<double, 3> response, In<int32_t, 1> first, In<int32_t, 1> node, In<double, 2> share) {
                const size_t count = rest.size();
                expect(count >= 1 && count <= GapConstraints::most, "gaps: 1 to 1024");
                expect(within(friction, 0.0, 100.0), "friction: 0 to 100");
                const size_t all = friction > 0 ? 3 * count : count;
                expect(between.shape(0) == all && between.shape(1) == all, "between: expected (rows, rows)");
                expect(response.shape(1) == 3 && response.shape(2) == all, "response: expected (vertices, 3, rows)");
                expect(first.size() == all + 1 && first(0) == 0 && size_t(first(all)) == node.size(),
                       "first: expected (rows + 1)");
                expect(give.size() == count, "give: expected (gaps)");
                for (size_t i = 0; i < count; i++) {
                    expect(within(give(i), 0.0, 1e9), "give: 0 to 1000000000 mm/N");
                    expect(rest(i) >= 0, "rest: below 0 mm");
                    expect(between(i, i) > 0, "between: a gap that no force opens");
                }
                for (size_t i = 0; i < all; i++) expect(first(i) <= first(i + 1), "first: descends");
                expect_vectors(share, node.size(), "share: expected (entries, 3)");
                expect_finite(rest, "rest: not finite");
                expect_finite(between, "between: not finite");
                expect_finite(response, "response: not finite");
                expect_finite(share, "share: not finite");
                expect_numbers(node, size_t(1) << 30, "node: below 0");
                new (self) GapConstraints();
                self->count = int(count), self->friction = friction, self->rows = int(all);
                self->stride = (self->rows + cache_line - 1) / cache_line * cache_line;
                self->rest = listed(rest), self->give = listed(give), self->first = listed(first),
                self->node = listed(node);
                self->between = padded(between.data(), all, self->rows, self->stride);
                self->response = padded(response.data(), 3 * response.shape(0), self->rows, self->stride);
                self->share.assign(share.data(), share.data() + share.size());
            },
            "rest"_as_is, "give"_as_is, "friction"_a, "between"_as_is, "response"_as_is, "first"_as_is, "node"_as_is,
            "share"_as_is,
            "rest: (gaps) mm. give: (gaps) mm/N of a spring, 0 of surfaces that may meet. friction: Coulomb's "
            "coefficient; "
            "above 0, two rows of slip for each gap follow the gaps' rows. between: (rows, rows) mm/N, N'K^-1 N. "
            "response: "
            "(vertices, 3, rows) mm/N, K^-1 N. first: (rows + 1), node: (entries) free nodes and share: (entries, 3) "
            "of N, "
            "row by row.");
    nb::class_<ComplianceModel, TissueModel>(m, "ComplianceModel",
                                             "Exact linear finite elements by tables of Green's functions.")
        .def_prop_rw(
            "looks_ahead", [](const ComplianceModel& m) { return m.looks_ahead.load(); },
            [](ComplianceModel& m, bool ahead) { m.looks_ahead = ahead; },
            "Whether tables are computed for what no hand is near to.")
        .def(
            "__init__",
            [](ComplianceModel* self, const SparseCholesky& factor, In<int32_t, 1> free, In<int32_t, 1> vertices,
               In<double, 2> nodes, size_t budget, In<double, 2> relaxation) {
                new (self) ComplianceModel(elastic(factor, free, vertices, nodes), budget, spectrum(relaxation));
            },
            "factor"_a, "free"_as_is, "vertices"_as_is, "nodes"_as_is, "budget"_a, "relaxation"_as_is,
            nb::keep_alive<1, 2>(),
            "factor: of the free nodes' stiffness, N/mm. free: (nodes) each node's number there, or -1. vertices: free "
            "nodes that are touched or shown. nodes: (nodes, 3) mm. budget: bytes of tables that a state may keep. "
            "relaxation: (terms, 2) shares of the instantaneous stiffness, and the times in s with which they relax.")
        .def(
            "__init__",
            [](ComplianceModel* self, const SparseCholesky& factor, In<int32_t, 1> free, In<int32_t, 1> vertices,
               In<double, 2> nodes, size_t budget, const GapConstraints& gaps) {
                check_gaps(gaps, vertices.size(), factor.tree.nodes());
                new (self) ComplianceModel(elastic(factor, free, vertices, nodes), budget, gaps);
            },
            "factor"_a, "free"_as_is, "vertices"_as_is, "nodes"_as_is, "budget"_a, "gaps"_a, nb::keep_alive<1, 2>())
        .def(
            "__init__",
            [](ComplianceModel* self, const SparseCholesky& factor, In<int32_t, 1> free, In<int32_t, 1> vertices,
               In<double, 2> nodes, size_t budget, const VibrationModes& modes) {
                expect(modes.shape.size() == 3 * size_t(modes.count()) * nodes.shape(0), "modes: of another mesh");
                new (self) ComplianceModel(elastic(factor, free, vertices, nodes), budget, modes);
            },
            "factor"_a, "free"_as_is, "vertices"_as_is, "nodes"_as_is, "budget"_a, "modes"_a, nb::keep_alive<1, 2>())
        .def(
            "__init__",
            [](ComplianceModel* self, const std::vector<const SparseCholesky*>& factors, In<int32_t, 1> free,
               In<int32_t, 1> vertices, In<double, 2> nodes, size_t budget, In<double, 1> times, In<double, 2> mix) {
                const LoadRecursion recursion = creep(times, mix, factors.size());
                std::vector<FactoredStiffness> samples;
                for (const SparseCholesky* factor : factors) {
                    expect(factor && factor->tree.nodes() == factors[0]->tree.nodes(), "factors: of different bodies");
                    samples.push_back(elastic(*factor, free, vertices, nodes));
                }
                new (self) ComplianceModel(std::move(samples), budget, recursion);
            },
            "factors"_a, "free"_as_is, "vertices"_as_is, "nodes"_as_is, "budget"_a, "times"_as_is, "mix"_as_is,
            nb::keep_alive<1, 2>(),
            "factors: (samples) of the stiffness at some values of the Laplace variable, from 0 to infinity. times: "
            "(fields) s. mix: (fields, samples): the compliances that creep with these times are sums of the "
            "samples'.");
}
