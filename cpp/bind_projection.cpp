#include "bind.h"

void bind_projection(nb::module_&) {}
