#include "bind.h"

void bind_reconstruction(nb::module_&) {}
