#include "bind.h"

void bind_mechanics(nb::module_&) {}
