#include "scatter/scatter_image.h"
#include "base/thread_pool.h"
#include <mutex>

namespace palpate {
namespace {

int64_t units(double keV) { return std::llround(keV / Budget::unit); }

// Adds a task's integers under a lock: exact, so that the order does not matter.
void add(std::vector<int64_t>& from, int64_t* to) {
    for (size_t i = 0; i < from.size(); i++) to[i] += from[i];
}

double behind_grid(const AntiscatterGrid& grid, const Materials& m, double keV, double tangent, double slant) {
    if (grid.height <= 0) return 1;
    const Materials::Place at = m.place(keV);
    return grid_transmission(grid, m.read(grid.septum_attenuation, 0, at), m.read(grid.interspace_attenuation, 0, at),
                             tangent, slant);
}

Photon emit(const Beam& beam, RandomStream& random) {
    const double u = random.uniform();
    const int64_t line = std::lower_bound(beam.cumulative, beam.cumulative + beam.energies - 1, u) - beam.cumulative;
    Photon photon{{}, {}, beam.keV[line], 0};
    double square = 0;
    for (int i = 0; i < 3; i++) {
        photon.position[i] = beam.source[i];
        const double to = i < 2 ? beam.low[i] + random.uniform() * (beam.high[i] - beam.low[i]) : 0;
        photon.direction[i] = to - beam.source[i];
        square += photon.direction[i] * photon.direction[i];
    }
    for (double& d : photon.direction) d /= std::sqrt(square);
    return photon;
}

// Pixel that a photon meets, -1 for none; signal: keV that the panel detects of it.
int64_t meet(const Photon& p, const Beam& beam, const FlatPanel& panel, const AntiscatterGrid& grid, const Materials& m,
             double& signal) {
    if (p.direction[2] >= 0) return -1;
    const double way = -p.position[2] / p.direction[2];
    const double x = p.position[0] + way * p.direction[0], y = p.position[1] + way * p.direction[1];
    const double column = std::floor((x - panel.corner[0]) / panel.pitch[0]);
    const double row = std::floor((y - panel.corner[1]) / panel.pitch[1]);
    if (column < 0 || row < 0 || column >= double(panel.columns) || row >= double(panel.rows)) return -1;
    const double slant = -1 / p.direction[2];
    const double septa = (x - beam.source[0]) / -beam.source[2]; // the tangent of the septa there
    signal = p.keV * behind_grid(grid, m, p.keV, p.direction[0] / p.direction[2] - septa, slant);
    if (panel.thickness) signal *= 1 - std::exp(-m.read(panel.thickness, 0, m.place(p.keV)) * slant);
    return int64_t(row) * panel.columns + int64_t(column);
}

} // namespace

Budget scatter_image(const Materials& m, const Body& body, const Beam& beam, const FlatPanel& panel,
                     const AntiscatterGrid& grid, int64_t photons, uint64_t seed, int64_t* out) {
    const std::vector<double> largest = largest_attenuation(m);
    const int64_t pixels = panel.rows * panel.columns, parts = int64_t(threads());
    Budget budget{};
    std::mutex lock;
    std::fill_n(out, 4 * pixels, 0);
    parallel_tasks(parts, [&](int64_t part, int) {
        std::vector<int64_t> image(size_t(4 * pixels), 0);
        Budget own{};
        const int64_t first = photons * part / parts, last = photons * (part + 1) / parts;
        for (int64_t n = first; n < last; n++) {
            RandomStream random(seed, uint64_t(n));
            Photon photon = emit(beam, random);
            const int64_t before = units(photon.keV);
            double deposited = 0, signal = 0;
            const bool left = follow(m, body, largest, photon, random, deposited);
            own.emitted += before;
            own.deposited += units(deposited);
            own.escaped += left ? units(photon.keV) : 0;
            if (!left) continue;
            const int64_t pixel = meet(photon, beam, panel, grid, m, signal);
            if (pixel >= 0) image[size_t(photon.order * pixels + pixel)] += units(signal);
        }
        const std::lock_guard<std::mutex> held(lock);
        add(image, out);
        budget.emitted += own.emitted, budget.deposited += own.deposited, budget.escaped += own.escaped;
    });
    return budget;
}

void pencil_kernels(const Materials& m, const Pencil& pencil, const PencilPanels& panels, int64_t photons,
                    uint64_t seed, int64_t* out) {
    constexpr double wide = 1e5;
    const int64_t material = 0;
    const double thickness = pencil.thickness, tangent = pencil.tangent, cosine = 1 / std::hypot(1, tangent);
    const double solid[Body::numbers] = {0, 0, 0, 1e9, 1e9, 1e9, -wide, -wide, 0, wide, wide, thickness};
    const Body body{&material, solid, 1, {-wide, -wide, 0}, {wide, wide, thickness}};
    const std::vector<double> largest = largest_attenuation(m);
    const double* rings = panels.radius;
    const int64_t columns = panels.radii + 1, size = panels.gaps * panels.grids * columns, parts = int64_t(threads());
    std::mutex lock;
    std::fill_n(out, size, 0);
    parallel_tasks(parts, [&](int64_t part, int) {
        std::vector<int64_t> own(size_t(size), 0);
        for (int64_t n = photons * part / parts; n < photons * (part + 1) / parts; n++) {
            RandomStream random(seed, uint64_t(n));
            Photon p{{0, 0, thickness}, {-tangent * cosine, 0, -cosine}, pencil.keV, 0};
            double deposited = 0;
            if (!follow(m, body, largest, p, random, deposited) || p.order == 0 || p.direction[2] >= 0) continue;
            const double slope = p.direction[0] / p.direction[2];
            for (int64_t g = 0; g < panels.gaps; g++) { // its last flight may have ended below: the line is the same
                const double way = -(p.position[2] + panels.gap[g]) / p.direction[2];
                const double x = p.position[0] + way * p.direction[0] + tangent * (thickness + panels.gap[g]);
                const double y = p.position[1] + way * p.direction[1];
                const int64_t ring = std::upper_bound(rings, rings + columns, std::hypot(x, y)) - rings - 1;
                if (ring < 0 || ring >= panels.radii) continue;
                for (int64_t k = 0; k < panels.grids; k++) {
                    const double passed = behind_grid(panels.grid[k], m, p.keV, slope - tangent, -1 / p.direction[2]);
                    int64_t* row = own.data() + (g * panels.grids + k) * columns;
                    row[ring] += units(p.keV * passed);
                    row[panels.radii] += units(p.keV * passed * x);
                }
            }
        }
        const std::lock_guard<std::mutex> held(lock);
        add(own, out);
    });
}

} // namespace palpate
