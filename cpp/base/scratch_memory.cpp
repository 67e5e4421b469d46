#include "base/scratch_memory.h"
#include "base/platform.h"
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <unordered_map>

namespace palpate {
namespace {

struct Mapping {
    size_t size;
    bool file;
};

std::mutex mutex;
std::unordered_map<void*, Mapping> mappings; // of all large arrays that there are
std::string folder;
uint64_t limit = UINT64_MAX;
ScratchUse use = {};

void* map(size_t size) {
    std::lock_guard lock(mutex);
    const bool file = !folder.empty() && use.in_memory + size > limit;
    void* memory = file ? map_file(folder, size, use.error) : map_memory(size);
    if (!memory) return nullptr;
    mappings[memory] = {size, file};
    (file ? use.in_files : use.in_memory) += size;
    use.most_in_memory = std::max(use.most_in_memory, use.in_memory);
    use.most_in_files = std::max(use.most_in_files, use.in_files);
    return memory;
}

// The size of a large array; 0 of any other memory.
size_t mapped_size(void* memory) {
    std::lock_guard lock(mutex);
    const auto found = mappings.find(memory);
    return found == mappings.end() ? 0 : found->second.size;
}

} // namespace

void set_scratch(const std::string& new_folder, uint64_t new_limit) {
    std::lock_guard lock(mutex);
    folder = new_folder, limit = new_limit;
    use.most_in_memory = use.in_memory, use.most_in_files = use.in_files, use.error = 0;
}

ScratchUse scratch_use() {
    std::lock_guard lock(mutex);
    return use;
}

void* scratch_malloc(size_t size) { return size < large_array ? std::malloc(std::max<size_t>(size, 1)) : map(size); }

void* scratch_calloc(size_t size) { return size < large_array ? std::calloc(std::max<size_t>(size, 1), 1) : map(size); }

void* scratch_realloc(void* memory, size_t size) {
    const size_t before = memory ? mapped_size(memory) : 0;
    if (before == 0 && size < large_array) return std::realloc(memory, std::max<size_t>(size, 1));
    void* moved = scratch_malloc(size);
    if (!moved) return nullptr;
    if (memory) {
        // What malloc gave is smaller than a large array, and the new one is one: it has room for all of it.
        void* whole = before > 0 ? memory : std::realloc(memory, large_array);
        if (!whole) {
            scratch_free(moved);
            return nullptr;
        }
        std::memcpy(moved, whole, before > 0 ? std::min(before, size) : large_array);
        scratch_free(whole);
    }
    return moved;
}

void scratch_free(void* memory) {
    if (!memory) return;
    Mapping mapping;
    {
        std::lock_guard lock(mutex);
        const auto found = mappings.find(memory);
        if (found == mappings.end()) {
            std::free(memory);
            return;
        }
        mapping = found->second;
        mappings.erase(found);
        (mapping.file ? use.in_files : use.in_memory) -= mapping.size;
    }
    unmap(memory, mapping.size);
}

} // namespace palpate
