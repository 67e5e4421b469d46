#include "base/scratch_memory.h"
#include "base/platform.h"
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <tuple>

namespace palpate {
namespace {

constexpr size_t page = 4096; // bytes; a multiple of it elsewhere, where nothing of `pass` happens

struct Mapping {
    size_t size;
    int file; // -1: in memory
};

std::mutex mutex;
std::map<char*, Mapping> mappings; // of all large arrays that there are
std::string folder;
uint64_t limit = UINT64_MAX;
ScratchUse use = {};

void* map(size_t size) {
    std::lock_guard lock(mutex);
    const bool file = !folder.empty() && use.in_memory + size > limit;
    int number = -1;
    void* memory = file ? map_file(folder, size, number, use.error) : map_memory(size);
    if (!memory) return nullptr;
    mappings[static_cast<char*>(memory)] = {size, number};
    (file ? use.in_files : use.in_memory) += size;
    use.most_in_memory = std::max(use.most_in_memory, use.in_memory);
    use.most_in_files = std::max(use.most_in_files, use.in_files);
    return memory;
}

// The size of a large array; 0 of any other memory.
size_t mapped_size(void* memory) {
    std::lock_guard lock(mutex);
    const auto found = mappings.find(static_cast<char*>(memory));
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

uint64_t scratch_limit() {
    std::lock_guard lock(mutex);
    return folder.empty() ? UINT64_MAX : limit;
}

// The caller holds the array, so that its mapping stays. Pages that belong to it in part are left as they are, but for
// reading.
void pass(void* memory, size_t size, Passing how) {
    char *begin = static_cast<char*>(memory), *start;
    Mapping mapping;
    {
        std::lock_guard lock(mutex);
        auto found = mappings.upper_bound(begin);
        if (found == mappings.begin()) return;
        std::tie(start, mapping) = *--found;
    }
    if (mapping.file < 0 || begin + size > start + mapping.size) return;
    const bool whole = how == Passing::read;
    const size_t from = (size_t(begin - start) + (whole ? 0 : page - 1)) / page * page;
    const size_t to = (size_t(begin - start) + size + (whole ? page - 1 : 0)) / page * page;
    if (from >= to) return;
    if (how == Passing::read) read_ahead(start + from, to - from);
    if (how == Passing::written) make_anew(start + from, to - from, mapping.file, from);
    if (how == Passing::done) write_behind(start + from, to - from, mapping.file, from);
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
        const auto found = mappings.find(static_cast<char*>(memory));
        if (found == mappings.end()) {
            std::free(memory);
            return;
        }
        mapping = found->second;
        mappings.erase(found);
        (mapping.file >= 0 ? use.in_files : use.in_memory) -= mapping.size;
    }
    unmap(memory, mapping.size, mapping.file);
}

} // namespace palpate
