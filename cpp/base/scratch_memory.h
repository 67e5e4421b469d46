// Memory of large arrays beyond what fits into memory: the first ones lie in memory, the others in files of a folder.
// The system keeps of the files what it has room for, and needs no swap. Arrays that existed before are left alone.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

namespace palpate {

constexpr size_t large_array = 1 << 20; // bytes; smaller ones come from malloc and are not counted

// From now on at most `limit` bytes of large arrays lie in memory. An empty folder: no limit, and no files.
void set_scratch(const std::string& folder, uint64_t limit);

struct ScratchUse {
    uint64_t in_memory, in_files, most_in_memory, most_in_files; // bytes, now and at most since set_scratch
    int error;                                                   // errno of the last file that could not be made, or 0
};
ScratchUse scratch_use();
uint64_t scratch_limit(); // UINT64_MAX: none

// What a pass over arrays in files tells the system of the bytes that come next, and of those that it is done with. Of
// other memory nothing happens. They take no longer than the disk does, and may run beside the pass.
enum class Passing {
    read,    // is read next, and maybe written to
    written, // is all written next; what it held is lost, and not read from the disk
    done,    // goes back to the disk
};
void pass(void* memory, size_t size, Passing how);

// What malloc, calloc, realloc and free do. On any thread; takes a lock.
void* scratch_malloc(size_t size);
void* scratch_calloc(size_t size);
void* scratch_realloc(void* memory, size_t size);
void scratch_free(void* memory);

} // namespace palpate
