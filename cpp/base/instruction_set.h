// The instruction set that the hot kernels run with here, for reports: palpate doctor, records, benchmarks.
#pragma once

namespace palpate {

const char* instruction_set();

} // namespace palpate
