#include "bind.h"

void bind_simulation(nb::module_&) {}
