// All that the kernels ask of the operating system beyond the C++ library: memory, thread priority, libraries found
// at run time, TCP sockets. Called by the folders that need them, on any thread. Linux, macOS and Windows.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

namespace palpate {

void prefer_huge_pages(void* memory, size_t size); // where the system offers a choice
int process_id();

// Memory from the system, zero: its own, or that of a file without a name in a folder, which the system writes out
// where it needs the room. nullptr and errno if there is none. file: its descriptor, -1 of the first kind, which is the
// only one on Windows.
void* map_memory(size_t size);
void* map_file(const std::string& folder, size_t size, int& file, int& error);
void unmap(void* memory, size_t size, int file);

// Of part of a mapped file, in whole pages. Each may do nothing where the system has no such call.
void read_ahead(void* memory, size_t size);                            // all of it, now
void make_anew(void* memory, size_t size, int file, size_t offset);    // zeros, without reading what there was
void write_behind(void* memory, size_t size, int file, size_t offset); // soon, and its memory is free then

// Asks for real-time priority for the calling thread (Linux: needs root, or a limit `rtprio` of at least 1), and for
// the finest timer. Returns whether it has the priority. Threads that it starts do not inherit it.
bool request_realtime_priority();
void lower_thread_priority();               // of the calling thread only, below ordinary ones
void set_background_niceness(int niceness); // how far below, from now on: 0 to 19, as of `nice`

// A counting semaphore. post() takes no lock and never waits, so the 1 kHz loop can wake a reader with it.
class Semaphore {
    void* handle;

public:
    Semaphore();
    ~Semaphore();
    Semaphore(const Semaphore&) = delete;
    void post();
    bool wait(int64_t timeout_ns); // false: nobody posted in time
};

// A library that stays loaded; nullptr and the system's reason if there is none.
void* open_library(const std::string& path, std::string& why);
void* find_symbol(void* library, const char* name); // nullptr: it has none

// TCP sockets that do not block; < 0 is none. Times in ns from now.
constexpr int would_block = -1;
std::string connect_tcp(const std::string& host, int port, int64_t timeout_ns, int& socket); // "", or why it failed
bool wait_readable(int socket, int64_t timeout_ns);
int receive_bytes(int socket, void* into, size_t size);     // how many; 0: closed, would_block, or less: broken
bool send_bytes(int socket, const void* from, size_t size); // all of them, or false
void finish_sending(int socket);
void close_socket(int socket);

} // namespace palpate
