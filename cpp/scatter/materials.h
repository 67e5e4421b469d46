#pragma once
// How materials weaken and scatter X-rays: tables of linear attenuation, form factors and incoherent scattering
// functions, as palpate.scans.scatter.cross_sections makes them.
#include <cmath>
#include <cstdint>

namespace palpate {

// All arrays are row-major, the first axis is the material. Energies are equally spaced in their logarithm.
struct Materials {
    int64_t count, energies, momenta;
    double log_first, log_step;               // of the energy in keV
    const double *photo, *rayleigh, *compton; // (count, energies) 1/mm
    const double* momentum;                   // (momenta) x = sin(angle/2)/wavelength, 1/angstrom, from 0, rising
    const double* form_integral;              // (count, momenta) integral of F^2 over x^2 from 0
    const double* incoherent_share;           // (count, momenta) S/Z, 0 to 1

    struct Place {
        int64_t index;
        double part;
    };
    Place place(double keV) const {
        const double at = (std::log(keV) - log_first) / log_step;
        const int64_t i = at <= 0 ? 0 : at >= double(energies - 2) ? energies - 2 : int64_t(at);
        return {i, at < 0 ? 0 : at - double(i)};
    }
    double read(const double* table, int64_t material, Place at) const {
        const double* row = table + material * energies + at.index;
        return row[0] + at.part * (row[1] - row[0]);
    }
};

constexpr double electron_rest_energy = 510.99895; // keV
constexpr double keV_angstrom = 12.398419843;      // photon energy times wavelength

} // namespace palpate
