// The way of a blade that is everywhere equally deep in a surface. From Python's palpate.tissue.incision and in the
// exported page.
#pragma once
#include "cutting/slit_complex.h"
#include "tissue/contact_surface.h"

namespace palpate {

constexpr double incision_step = 2; // mean edges between the points at which a blade follows the surface

// A polyline's points, moved by at most a millionth of its length, so that parts along which a blade of this way lies
// in one plane but for that do lie in it: two planes that are nearly one meet in no clear line.
std::vector<Point3> straightened(std::vector<Point3> path, const double way[3]);

struct Incision {
    Point3 way;                // unit, from the blade's upper end to its tip; 0 if the normals cancel
    std::vector<Point3> upper; // mm, where its upper end goes
    // Its triangles, two for each part of the way; `depth` mm from the upper end to the tip. None if one were flat.
    std::vector<BladeTriangle> swept(double depth) const;
};

// path: corners on the surface or near it, mm. The blade follows the surface at points no farther from each other than
// `step` mm, and its upper end is `above` mm over it. direction: of the blade; null: against the mean normal.
Incision incision(const ContactSurface& surface, const std::vector<Point3>& path, double step, double above,
                  const double* direction);

} // namespace palpate
