#pragma once
// The proxy of a tool: where its contact really is, while the device may ask for more (the god-object of C. B. Zilles &
// J. K. Salisbury, Proc. IROS 1995). Updated by Simulation once a tick, on the loop's thread.
#include "base/vec3.h"
#include "simulation/cut_resistance.h"
#include "simulation/device.h"
#include "tissue/contact_surface.h"
#include <memory>
#include <type_traits>

namespace palpate {

// How fast a proxy follows its command. A pointer sends some 60 commands a second and the loop runs 1000 ticks: between
// commands the proxy moves on smoothly, so that the force has no steps. It counts ticks, never the clock, so that a
// recording replays exactly.
struct ToolMotion {
    double approach = 0.08; // part of the remaining distance covered a tick: 63 % after 12 ms
    double reach = 1.0;     // mm a tick at most, along the surface and in displacement: 1 m/s
};

// Needle insertion in the three parts of A. M. Okamura, C. Simone & M. D. O'Leary, IEEE Trans. Biomed. Eng. 51 (2004)
// 1707: the tissue's stiffness until puncture, then cutting at the tip and friction along the shaft.
struct NeedleForces {
    double puncture = 0.6;  // N, at which the surface is pierced
    double cutting = 0.3;   // N, at the tip
    double friction = 0.02; // N for each mm of shaft in the tissue
};

// A blade and the end of its cut, as a bristle and its foot in P. R. Dahl's model of friction (AIAA J. 14 (1976) 1675):
// the tissue holds the blade back by a spring until the force makes new surface, then the cut follows. The spring stays
// the same throughout a stroke: a stiffer one where the tissue is tougher would give the hand energy.
struct BladeForces {
    std::shared_ptr<const CutResistance> tissue; // what new surface takes; none: nothing
    double friction = 0;                         // N for each mm of the edge in the tissue
    double give = 0.5; // mm that a blade, as deep as it went in, is ahead of its cut where the tissue is toughest
    double most(double depth) const { return depth * (1e-3 * (tissue ? tissue->toughest : 0) + friction); } // N
    double resistance(const double at[3], const double edge[3]) const;                                      // N
};

struct ToolSettings {           // of all tools
    double radius = 5;          // of the contact, mm
    double friction = 0.3;      // Coulomb coefficient of tools in space
    bool nodal_weights = false; // ContactSurface::nodal_patch(), for records of version 0.1
    ToolMotion motion;
    NeedleForces needle;
    BladeForces blade;
};

enum class ContactState : uint8_t {
    idle,    // no command
    closed,  // in contact: the tissue under the tool is displaced with it
    refused, // cannot be held here (fixed nodes, a command that is no number); until the tool is taken away
    open,    // follows the tissue without a force: a tool in space, or one about to close
    cutting, // a blade in the tissue: its force is that of the cut, and the model knows nothing of it
    carrying // holds a loose piece: its force is that piece's weight
};

struct ToolProxy {
    ContactState state = ContactState::idle;
    CommandKind kind = CommandKind::away;
    SurfacePoint at; // the contact, or the end of a cut, on the surface at rest
    ContactPatch patch;
    double displacement[3] = {0, 0, 0}; // mm, of the patch's weighted mean; of a blade from the end of its cut
    double force[3] = {0, 0, 0};        // N, of the tissue on the tool: the model's last answer
    double tip[3] = {0, 0, 0};          // mm, of the tool, in space
    int64_t contact_tick = 0;           // at which the contact closed

    double slope[3] = {0, 0, 0};      // N, increase of the tissue's energy for each mm that the contact slides
    double drag[3] = {0, 0, 0};       // over |force|: load on a sliding tool that pays for that increase
    double damping[3] = {0, 0, 0};    // over |force|: load of the passivity controller
    double slide_path[3] = {0, 0, 0}; // mm, recent sliding, exponentially weighted
    double slide_length = 0;          // mm, length of that path

    // Of a tool in space.
    bool seen_outside = false;                // it has been outside the tissue, so that it may touch it
    bool released = false;                    // it has let go, and the tissue has not moved yet
    double filtered_slope[3] = {0, 0, 0};     // N, `slope` low-pass filtered
    double first_displacement[3] = {0, 0, 0}; // mm, of the tissue when it was touched
    double compliance_sums[2] = {0, 0};       // mm N and N^2, over the first ticks of the contact
    double compliance = 0;                    // mm/N, displacement over force: how far it slides for an excess force
    int learning_ticks = 0;                   // ticks until the compliance is known

    // Of a needle.
    bool pierced = false;
    double way[3] = {0, 0, 0};  // mm, its tip from where it entered
    double axis[3] = {0, 0, 0}; // once it has pierced the surface
    double insertion = 0;       // mm of it inside the tissue

    // Of a blade.
    double stiffness = 0;  // N/mm, of its spring
    double resistance = 0; // N, at which its cut goes on

    // Of a tool that carries a piece.
    int piece = -1;             // its number
    double grip[3] = {0, 0, 0}; // mm, from the tip to the piece's offset

    void total_force(double out[3]) const { // N, on the tool
        const double size = length(force);
        for (int k = 0; k < 3; k++) out[k] = force[k] + size * (drag[k] + damping[k]);
    }
    void clear_drag() {
        slide_length = 0;
        for (int k = 0; k < 3; k++) drag[k] = slide_path[k] = 0;
    }
    void clear_forces() {
        for (int k = 0; k < 3; k++) force[k] = slope[k] = damping[k] = 0;
        clear_drag();
    }
};

// The loop copies proxies to look ahead: nothing in them may allocate.
static_assert(std::is_trivially_copyable_v<ToolProxy>);

bool is_finite(const Command& command);

// One tick of the way from a point to another, mm.
void approach(double from[3], const double to[3], const ToolMotion& motion);

// The patch of the contact where it is; if there is none, the contact is refused.
bool find_patch(ToolProxy& proxy, const ContactSurface& surface, const ToolSettings& settings, SurfaceScratch& scratch);

// One tick of one tool: closes the contact, follows the command, slides, pierces, or opens. others: whether another
// tool holds the tissue. known: whether the model's last answer had all its tables.
void update_proxy(ToolProxy& proxy, const Command& command, const ContactSurface& surface, const ToolSettings& settings,
                  bool others, bool known, SurfaceScratch& scratch);

} // namespace palpate
