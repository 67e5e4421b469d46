#include "bindings/module.h"
#include <system_error>

NB_MODULE(_core, m) {
    m.doc() = "palpate's kernels: a submodule for each folder of cpp/.";
    nb::register_exception_translator([](const std::exception_ptr& thrown, void*) {
        try {
            std::rethrow_exception(thrown);
        } catch (const std::system_error& error) { // no more threads, above all
            PyErr_SetObject(PyExc_OSError, nb::make_tuple(error.code().value(), error.code().message().c_str()).ptr());
        }
    });
    const struct {
        const char *name, *doc;
        void (*bind)(nb::module_&);
    } submodules[] = {
        {"base", "Threads, instruction sets, checks of arrays.", bind_base},
        {"volume", "Resampling of voxel grids.", bind_volume},
        {"phantom", "Exact transmission through convex solids.", bind_phantom},
        {"scatter", "Monte Carlo of X-rays in tissue.", bind_scatter},
        {"projection", "The system matrix A: scan geometry, forward and back projection.", bind_projection},
        {"statistics", "Log-likelihood of the counts and Markov random field prior.", bind_statistics},
        {"icd", "Iterative coordinate descent.", bind_icd},
        {"subspace", "The majorize-minimize memory-gradient step.", bind_subspace},
        {"linalg", "Sparse Cholesky factors.", bind_linalg},
        {"cutting", "Unknowns that a cut adds.", bind_cutting},
        {"tissue", "What all tissue models share: interface, contact surface and patches.", bind_tissue},
        {"elements", "The stiffness of linear elasticity.", bind_elements},
        {"relaxation", "Models relaxed ring by ring: mass-spring and block Gauss-Seidel.", bind_relaxation},
        {"multigrid", "Linear finite elements by multigrid-preconditioned conjugate gradients.", bind_multigrid},
        {"compliance", "Linear finite elements by cached Green's functions.", bind_compliance},
        {"hyperelastic", "Neo-Hookean finite elements at finite strain.", bind_hyperelastic},
        {"multirate", "Finite strain at two rates.", bind_multirate},
        {"simulation", "The 1 kHz loop: tools, passivity, recording, replay.", bind_simulation},
        {"haptics", "Force-feedback devices and their servo.", bind_haptics},
        {"benchmark", "Timing of the loop's parts; for tests, benchmarks and studies.", bind_benchmark},
    };
    for (const auto& each : submodules) {
        nb::module_ submodule = m.def_submodule(each.name, each.doc);
        each.bind(submodule);
    }
}
