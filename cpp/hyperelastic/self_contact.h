#pragma once
// Contact of the tissue's surface with itself, as an energy beside that of the elements. HyperelasticModel calls it in
// the loop's thread or a solver's; immutable, but for what the caller keeps in `work`.
// Signed distance: J. A. Baerentzen & H. Aanaes, IEEE Trans. Vis. Comput. Graph. 11 (2005) 243.
#include "hyperelastic/hyperelastic_energy.h"
#include "tissue/contact_surface.h"
#include <vector>

namespace palpate {

// Elements, and for each vertex of their surface and middle of an edge that comes closer than `gap` to another part of
// it, or gets behind it,
//
//     E = A mu / (4 gap) ((gap - s)^2 + 3 min(s, 0)^2)
//
// s: the point's signed distance to that part; A: its area; mu: the shear modulus there. So the pressure at s = 0 is
// mu / 2, and 2.5 mu where parts overlap by the gap. There is no friction. Another part is what does not hang together
// with the point within 3 edges at rest, or faces it across a cleft, and is not closer than the gap at rest. Only a
// part that the point was before, not behind, in the last accepted step can be met: behind is also the far side of a
// wall. The energy is infinite where a vertex has moved too far since then to tell.
class SelfContact : public HyperelasticEnergy {
public:
    static constexpr double gap = 0.2; // mm

    // surface: of the elements' nodes; both must outlive this. mu: (nodes) N/mm^2.
    SelfContact(const HyperelasticEnergy& elements, const ContactSurface& surface, const double* mu);

    Energy energy(const double* u, double* force, double* ratio, double* work) const override;
    double least_ratio(const double* u, const double* ratio) const override { return elements.least_ratio(u, ratio); }
    // Of the contacts the part that grows with mu: the turning of their normals is left out, so that it stays positive.
    void tangent(const double* u, const double* v, int count, double* out, double* work) const override;
    const HyperelasticEnergy& elastic() const override { return elements; }
    bool accept(const double* u, double* work) const override;
    double longest_move(const double* work) const override;

    int nodes() const override { return elements.nodes(); }
    int padded() const override { return elements.padded(); }
    size_t work_size() const override { return elements.work_size() + size; }

private:
    const HyperelasticEnergy& elements;
    const ContactSurface& surface;
    double edge = 0; // mean length, mm
    struct Point {
        int end[2];       // vertices, whose middle it is; twice the same for a vertex
        double stiffness; // A mu / (2 gap), N/mm
    };
    std::vector<Point> points;
    std::vector<int> around_start, around;     // triangles at each vertex
    std::vector<int> excluded_start, excluded; // triangles that are no other part for each vertex, in ascending order
    size_t size = 0;
    struct Near;
    struct Contact;
    Near near(double* work) const;
    void add_points(const double* mu);
    void exclude_neighbours();
    bool is_excluded(int vertex, int triangle) const;
    double place_vertices(const Near& near, const double* u) const;
    void find_near(const Near& near) const;
    double farthest(const Near& near) const;
    void add_vertex_normal(const double* position, int vertex, double out[3]) const;
    double signed_distance(const double* position, const double* x, Contact& at) const;
    bool went_through(const Near& near, int point, const Contact& at) const;
    bool contact_of(const Near& near, int point, Contact& found) const;
    template <class Act> bool for_each_contact(const double* u, double* work, Act&& act) const;
};

} // namespace palpate
