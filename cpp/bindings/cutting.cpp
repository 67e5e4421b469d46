#include "bindings/arrays.h"
#include "cutting/jump_factor.h"

using namespace nb::literals;
using namespace palpate;

namespace {

Owned<double, 2> taken(const JumpFactor& factor, In<double, 2> b) {
    expect(b.shape(0) == size_t(factor.size()), "b: one row an unknown");
    auto out = uninitialized<double>(b.shape(0), b.shape(1));
    std::copy_n(b.data(), b.size(), out.data());
    return out;
}

} // namespace

void bind_cutting(nb::module_& m) {
    nb::class_<JumpFactor>(m, "JumpFactor", "The factor M = L S L' of the unknowns of a cut; it grows by rows.")
        .def(
            "__init__",
            [](JumpFactor* self, int capacity) {
                expect(within(capacity, 0, 12000), "capacity: 0 to 12000 unknowns");
                new (self) JumpFactor(capacity);
            },
            "capacity"_a)
        .def_prop_ro("size", &JumpFactor::size, "Unknowns so far.")
        .def(
            "append",
            [](JumpFactor& self, In<double, 2> rows, double sign, double least) {
                expect(rows.shape(0) <= size_t(self.capacity - self.size()), "rows: more than there is room for");
                expect(rows.shape(1) == self.size() + rows.shape(0), "rows: expected (new, all with the new)");
                expect((sign == 1 || sign == -1) && least >= 0, "sign: 1 or -1; least: 0 or more");
                return unlocked([&] { return self.append(rows.data(), int(rows.shape(0)), sign, least); });
            },
            "rows"_as_is, "sign"_a, "least"_a,
            "Rows of M's lower triangle; False, and none, if a pivot all but vanishes.")
        .def(
            "reduce",
            [](const JumpFactor& self, In<double, 2> b) {
                auto out = taken(self, b);
                unlocked([&] { self.reduce(out.data(), int(out.shape(1)), 0); });
                return out;
            },
            "b"_as_is, "z = L^-1 b, (unknowns, columns).")
        .def(
            "expand",
            [](const JumpFactor& self, In<double, 2> z) {
                auto out = taken(self, z);
                unlocked([&] { self.expand(out.data(), int(out.shape(1))); });
                return out;
            },
            "z"_as_is, "x = L^-T S z, so that M x = b.")
        .def(
            "blocks",
            [](const JumpFactor& self, In<double, 3> z, In<double, 3> w) {
                const size_t n = size_t(self.size());
                expect(z.shape(1) == 3 && w.shape(1) == 3 && z.shape(2) == n && w.shape(2) == n,
                       "z, w: expected (loads, 3, unknowns)");
                expect(z.shape(0) == w.shape(0), "z, w: as many loads");
                auto out = zeros<double>(z.shape(0), 3, 3);
                unlocked([&] {
                    for (size_t k = 0; k < z.shape(0); k++)
                        self.block(z.data() + 3 * n * k, w.data() + 3 * n * k, int(n), out.data() + 9 * k);
                });
                return out;
            },
            "z"_as_is, "w"_as_is, "The sum of s z w', (loads, 3, 3), of pairs of loads.");
}
