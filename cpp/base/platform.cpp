#include "base/platform.h"
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <thread>
#ifdef _WIN32
#define NOMINMAX
#include <winsock2.h> // before windows.h

#include <windows.h>
#include <ws2tcpip.h>
#else
#include <dlfcn.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>
#endif
#ifdef __APPLE__
#include <dispatch/dispatch.h>
#endif
#ifdef __linux__
#include <sched.h>
#include <semaphore.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <time.h>
#endif
#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0
#endif

namespace palpate {

void prefer_huge_pages([[maybe_unused]] void* memory, [[maybe_unused]] size_t size) {
#ifdef __linux__
    madvise(memory, size, MADV_HUGEPAGE);
#endif
}

#ifdef _WIN32
void* map_memory(size_t size) { return VirtualAlloc(nullptr, size, MEM_COMMIT | MEM_RESERVE, PAGE_READWRITE); }
void* map_file(const std::string&, size_t, int&, int& error) {
    error = ENOSYS;
    return nullptr;
}
void unmap(void* memory, size_t, int) { VirtualFree(memory, 0, MEM_RELEASE); }
#else
void* map_memory(size_t size) {
    void* memory = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return memory == MAP_FAILED ? nullptr : memory;
}
void* map_file(const std::string& folder, size_t size, int& file, int& error) {
    std::string name = folder + "/palpate-scratch-XXXXXX";
    file = mkstemp(name.data());
    if (file < 0) {
        error = errno;
        return nullptr;
    }
    unlink(name.c_str()); // it is gone with this process, however that ends
    fcntl(file, F_SETFD, FD_CLOEXEC);
#ifdef __APPLE__
    error = ftruncate(file, off_t(size)) ? errno : 0;
#else
    error = posix_fallocate(file, 0, off_t(size)); // a full disk is told here, not by a signal later
#endif
    void* memory = error ? MAP_FAILED : mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (memory == MAP_FAILED && !error) error = errno;
    if (memory != MAP_FAILED) return memory;
    close(file);
    file = -1;
    return nullptr;
}
void unmap(void* memory, size_t size, int file) {
    munmap(memory, size);
    if (file >= 0) close(file);
}
#endif

#ifdef __linux__
#ifndef MADV_POPULATE_READ // of Linux 5.14; older ones refuse it
#define MADV_POPULATE_READ 22
#define MADV_POPULATE_WRITE 23
#endif
void read_ahead(void* memory, size_t size) {
    if (madvise(memory, size, MADV_POPULATE_READ)) madvise(memory, size, MADV_WILLNEED);
}
// The file's blocks stay where they are, so that a disk cannot be full later.
void make_anew(void* memory, size_t size, int file, size_t offset) {
    if (fallocate(file, FALLOC_FL_ZERO_RANGE, off_t(offset), off_t(size)) == 0)
        madvise(memory, size, MADV_POPULATE_WRITE);
}
void write_behind(void* memory, size_t size, int file, size_t offset) {
    madvise(memory, size, MADV_DONTNEED); // of a shared file it forgets where the pages are, not what they hold
    sync_file_range(file, off_t(offset), off_t(size), SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER);
    posix_fadvise(file, off_t(offset), off_t(size), POSIX_FADV_DONTNEED);
}
#else
void read_ahead(void*, size_t) {}
void make_anew(void*, size_t, int, size_t) {}
void write_behind(void*, size_t, int, size_t) {}
#endif

bool request_realtime_priority() {
#ifdef __linux__
    prctl(PR_SET_TIMERSLACK, 1000UL);                          // ns; the default is 50 us
    if (std::thread::hardware_concurrency() < 2) return false; // one thread must not keep the only processor
    sched_param lowest = {};
    lowest.sched_priority = 1;
    return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0;
#else
    return false;
#endif
}

static std::atomic<int> background_niceness = 5;

void set_background_niceness(int niceness) { background_niceness = niceness; }

void lower_thread_priority() {
#ifdef __linux__
    setpriority(PRIO_PROCESS, id_t(syscall(SYS_gettid)), background_niceness);
#endif
}

#if defined(_WIN32)
Semaphore::Semaphore() : handle(CreateSemaphoreW(nullptr, 0, 0x7fffffff, nullptr)) {}
Semaphore::~Semaphore() { CloseHandle(handle); }
void Semaphore::post() { ReleaseSemaphore(handle, 1, nullptr); }
bool Semaphore::wait(int64_t timeout_ns) {
    return WaitForSingleObject(handle, DWORD(timeout_ns / 1000000)) == WAIT_OBJECT_0;
}
#elif defined(__APPLE__)
Semaphore::Semaphore() : handle(dispatch_semaphore_create(0)) {}
Semaphore::~Semaphore() { dispatch_release(dispatch_semaphore_t(handle)); }
void Semaphore::post() { dispatch_semaphore_signal(dispatch_semaphore_t(handle)); }
bool Semaphore::wait(int64_t timeout_ns) {
    return dispatch_semaphore_wait(dispatch_semaphore_t(handle), dispatch_time(DISPATCH_TIME_NOW, timeout_ns)) == 0;
}
#else
Semaphore::Semaphore() : handle(new sem_t) { sem_init(static_cast<sem_t*>(handle), 0, 0); }
Semaphore::~Semaphore() { sem_destroy(static_cast<sem_t*>(handle)), delete static_cast<sem_t*>(handle); }
void Semaphore::post() { sem_post(static_cast<sem_t*>(handle)); }
bool Semaphore::wait(int64_t timeout_ns) {
    timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    const int64_t end = until.tv_nsec + timeout_ns;
    until.tv_sec += end / 1000000000, until.tv_nsec = end % 1000000000;
    int failed;
    while ((failed = sem_timedwait(static_cast<sem_t*>(handle), &until)) != 0 && errno == EINTR);
    return failed == 0;
}
#endif

#ifdef _WIN32

namespace {

using Size = int;
bool start_sockets() {
    WSADATA about;
    return WSAStartup(MAKEWORD(2, 2), &about) == 0;
}
int last_error() { return WSAGetLastError(); }
bool is_transient(int error) { return error == WSAEWOULDBLOCK || error == WSAEINTR; }
bool is_connecting(int error) { return error == WSAEWOULDBLOCK; }
void stop_blocking(int socket) {
    u_long yes = 1;
    ioctlsocket(socket, FIONBIO, &yes);
}
bool wait_ready(int socket, short what, int64_t timeout_ns) {
    WSAPOLLFD one{SOCKET(socket), what, 0};
    return WSAPoll(&one, 1, int(timeout_ns / 1000000)) > 0;
}
constexpr int timed_out = WSAETIMEDOUT, stop_sending = SD_SEND;

} // namespace

int process_id() { return int(GetCurrentProcessId()); }

void* open_library(const std::string& path, std::string& why) {
    HMODULE library = LoadLibraryA(path.c_str());
    if (!library) why = path + ": error " + std::to_string(GetLastError());
    return library;
}

void* find_symbol(void* library, const char* name) {
    return reinterpret_cast<void*>(GetProcAddress(HMODULE(library), name));
}

void close_socket(int socket) { closesocket(socket); }

#else

namespace {

using Size = size_t;
bool start_sockets() { return true; }
int last_error() { return errno; }
bool is_transient(int error) { return error == EAGAIN || error == EWOULDBLOCK || error == EINTR; }
bool is_connecting(int error) { return error == EINPROGRESS; }
void stop_blocking(int socket) {
    fcntl(socket, F_SETFL, fcntl(socket, F_GETFL) | O_NONBLOCK);
    fcntl(socket, F_SETFD, FD_CLOEXEC);
}
bool wait_ready(int socket, short what, int64_t timeout_ns) {
    pollfd one{socket, what, 0};
#ifdef __linux__ // to the microsecond: a millisecond is a whole tick
    timespec timeout{time_t(timeout_ns / 1000000000), long(timeout_ns % 1000000000)};
    return ppoll(&one, 1, &timeout, nullptr) > 0;
#else
    return poll(&one, 1, int(timeout_ns / 1000000)) > 0;
#endif
}
constexpr int timed_out = ETIMEDOUT, stop_sending = SHUT_WR;

} // namespace

int process_id() { return int(getpid()); }

void* open_library(const std::string& path, std::string& why) {
    void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        const char* error = dlerror();
        why = error ? error : path;
    }
    return library;
}

void* find_symbol(void* library, const char* name) { return dlsym(library, name); }

void close_socket(int socket) { close(socket); }

#endif

std::string connect_tcp(const std::string& host, int port, int64_t timeout_ns, int& socket) {
    addrinfo hints{}, *all = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    if (!start_sockets()) return "this system has no sockets";
    if (int bad = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &all)) return gai_strerror(bad);
    std::string why = "no address";
    for (addrinfo* each = all; each && socket < 0; each = each->ai_next) {
        int s = int(::socket(each->ai_family, each->ai_socktype, each->ai_protocol));
        if (s < 0) continue;
        stop_blocking(s);
        int bad = ::connect(s, each->ai_addr, socklen_t(each->ai_addrlen)) ? last_error() : 0;
        if (is_connecting(bad)) {
            socklen_t size = sizeof bad;
            if (!wait_ready(s, POLLOUT, timeout_ns))
                bad = timed_out;
            else
                getsockopt(s, SOL_SOCKET, SO_ERROR, reinterpret_cast<char*>(&bad), &size);
        }
        if (bad) {
            why = std::strerror(bad);
            close_socket(s);
            continue;
        }
        const int yes = 1;
        setsockopt(s, IPPROTO_TCP, TCP_NODELAY, reinterpret_cast<const char*>(&yes), sizeof yes);
#ifdef SO_NOSIGPIPE
        setsockopt(s, SOL_SOCKET, SO_NOSIGPIPE, &yes, sizeof yes);
#endif
        socket = s;
    }
    freeaddrinfo(all);
    return socket < 0 ? why : "";
}

bool wait_readable(int socket, int64_t timeout_ns) {
    return wait_ready(socket, POLLIN, std::max<int64_t>(0, timeout_ns));
}

int receive_bytes(int socket, void* into, size_t size) {
    const int got = int(recv(socket, static_cast<char*>(into), Size(size), 0));
    return got >= 0 ? got : is_transient(last_error()) ? would_block : would_block - 1;
}

bool send_bytes(int socket, const void* from, size_t size) {
    return send(socket, static_cast<const char*>(from), Size(size), MSG_NOSIGNAL) == std::ptrdiff_t(size);
}

void finish_sending(int socket) { shutdown(socket, stop_sending); }

} // namespace palpate
