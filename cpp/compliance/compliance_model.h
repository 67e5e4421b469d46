#pragma once
// Linear FEM, elastic, viscoelastic or with inertia, by cached Green's functions. Simulation calls it through
// TissueModel, in the loop's thread; the tables are computed by PrecomputeThread. Method: D. L. James & D. K. Pai,
// ArtDefo, SIGGRAPH 1999.
#include "compliance/precompute_thread.h"
#include "compliance/vibration_modes.h"

namespace palpate {

// The contact stiffness S = C^-1 of the patches, C_ab = sum w_ai w_bj G_ij, comes from blocks between their nodes. If
// some are not computed yet, the last stiffness serves; once they are, the difference fades out over some ticks.
struct ComplianceState : ModelState {
    ComplianceState(const std::vector<FactoredStiffness>& samples, size_t budget, const LoadRecursion& recursion,
                    const VibrationModes& modes, const GapConstraints& gaps);
    ~ComplianceState() override;
    std::vector<double>& state_vector() override { return values; } // u is not used: a tick solves for its patches only
    void reset() override;
    static constexpr int most = 3 * TissueModel::max_patches;
    enum Layout { // of `values`; the history's numbers follow
        prescribed_at = 0,
        observed_at = 1,
        force_at = 2,
        displacement_at = force_at + most,
        stiffness_at = displacement_at + most,
        offset_at = stiffness_at + most * most,
        known_at = offset_at + most * most,
        size = known_at + 1
    };

    // Prescribed and observed contacts (2); forces, displacements (3 per patch each); the stiffness in use, its
    // difference to the exact one (3 prescribed by 3 prescribed, each); 1: the difference is known, -1: it is not; the
    // history's numbers, or what `GapConstraints` keeps of a state.
    std::vector<double> values;
    std::unique_ptr<GapSolver> gaps; // of a body with surfaces that may meet
    double* gap_force() { return &values[size]; }
    const double* gap_force() const { return &values[size]; }
    bool continues = false;               // a body before it, and no gap has been looked at yet
    std::unique_ptr<LoadHistory> history; // of a tissue that relaxes or has inertia
    std::unique_ptr<ModalMotion> motion;  // of one that has inertia
    std::vector<double> shapes;           // (patches, modes, 3) of the modes under each patch
    double* shape(int patch) { return &shapes[shapes.size() / TissueModel::max_patches * patch]; }
    struct Sample { // of the body's compliance
        Sample(const FactoredStiffness& stiffness, size_t budget) : greens(stiffness, budget) {}
        GreensFunctions greens;
        TripleBuffer<ContactSnapshot> snapshots; // written by ticks
        PatchBlocks blocks, spare_blocks;        // of the patches; of those before, or of those expected next
        std::unique_ptr<PrecomputeThread> precompute;
    };
    std::vector<std::unique_ptr<Sample>> samples;
    std::vector<GreensFunctions*> greens; // theirs
    const PatchBlocks& blocks() const { return samples[0]->blocks; }
    bool blocks_known() const;
    ContactSnapshot snapshot;
    std::vector<double> weight, elastic; // (patches, capacity) of each patch's vertices; (samples, vertices, 3) G_s f
    std::vector<double> acting;          // (loads, 3) N, what a sample's field is due to
    std::vector<float> field, part;      // (vertices, 3) mm, last displayed, and what a sample adds to it
};

// Exact for every mesh size: a tick costs the square of the patch's number of nodes, whatever the mesh's. Without
// contact the body is at rest, unless it has been touched before and its stiffness relaxes or it has inertia.
class ComplianceModel : public TissueModel {
public:
    // stiffness: in the long term. budget: bytes of tables per state.
    ComplianceModel(FactoredStiffness stiffness, size_t budget, const RelaxationSpectrum& spectrum = {});
    // An elastic body with surfaces that may meet.
    ComplianceModel(FactoredStiffness stiffness, size_t budget, GapConstraints gaps);
    ComplianceModel(FactoredStiffness stiffness, size_t budget, VibrationModes modes);
    // A body whose parts relax differently: its stiffness at the samples of the Laplace variable that `creep` mixes,
    // in the long term first and instantaneously last.
    ComplianceModel(std::vector<FactoredStiffness> samples, size_t budget, const LoadRecursion& creep);
    ComplianceModel(const ComplianceModel&) = delete; // `stiffness` refers into it
    int nodes() const override { return stiffness.nodes(); }
    std::unique_ptr<ModelState> make_state() const override;
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;
    double energy(const ModelState& state, int prescribed, const double* displacement,
                  const double* force) const override;
    void displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const override;
    void displacement(ModelState& state, double* out) const override;
    bool continue_from(ModelState& state, const ModelState& from) const override;
    void prefetch(ModelState& state, const ContactPatch* patches, int count) const override;
    void begin_realtime(ModelState& state) const override;
    void end_realtime(ModelState& state) const override;
    bool contact_slope(const ModelState& state, int patch, double* out) const override;
    // The contact stiffness that the last tick has used, (3 prescribed, 3 prescribed) N/mm.
    static const double* contact_stiffness(const ComplianceState& state);

    const std::vector<FactoredStiffness> samples;
    const FactoredStiffness& stiffness; // the first of them: in the long term
    const LoadRecursion recursion;
    const VibrationModes modes;
    const GapConstraints gaps;
    // Whether tables are computed for what no hand is near to; not while another body is made, which needs the
    // processor.
    std::atomic<bool> looks_ahead{true};

private:
    const size_t budget;
    void resize_contacts(ComplianceState& s, int prescribed) const;
    void release(ComplianceState& s) const;
    bool set_patches(ComplianceState& s, const ContactPatch* patches, int count) const;
    void patch_compliance(const ComplianceState& s, int a, int b, double out[9]) const;
    void publish_snapshots(ComplianceState& s) const;
    const double* acting_loads(ComplianceState& s, int sample) const;
    const float* sample_field(ComplianceState& s, int sample) const;
    void find_blocks(ComplianceState& s) const;
    void compute_missing(ComplianceState& s) const;
    void subtract_history(ComplianceState& s, int prescribed, double* driving) const;
    void present_displacement(ComplianceState& s, int patch, double out[3]) const;
    void advance_history(ComplianceState& s, int prescribed, const double* displacement, const double* force) const;
    void write_history(ComplianceState& s) const;
    bool update_stiffness(ComplianceState& s, int prescribed, const double* displacement) const;
    void close_gaps(ComplianceState& s, int prescribed, const double* displacement, double* added) const;
    void apply_stiffness(ComplianceState& s, int prescribed, const double* displacement, const double* added,
                         double* force) const;
    void observe(ComplianceState& s, int prescribed, int observed, double* displacement, double* force) const;
};

} // namespace palpate
