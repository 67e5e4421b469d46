#pragma once
// A maker's library, loaded at run time: never shipped with us, never linked. It stays loaded, since its threads may
// outlive the driver.
#include "base/platform.h"
#include "haptics/driver.h"
#include <string>
#include <vector>

namespace palpate {

class SharedLibrary {
    struct Entry {
        const char* name;
        void** address;
    };
    std::vector<Entry> wanted;

public:
    // A function of the library, to be called once it is loaded; declared beside it.
    template <class F> class Function {
        void* address = nullptr;

    public:
        Function(SharedLibrary& library, const char* name) { library.wanted.push_back({name, &address}); }
        Function(const Function&) = delete;
        template <class... Given> auto operator()(Given... given) const {
            return reinterpret_cast<F*>(address)(given...);
        }
    };

    // Tries `path` alone, or each of `names` on the loader's path, and finds all its functions.
    void load(const std::string& path, const std::vector<std::string>& names, const std::string& advice) {
        std::string why;
        for (const auto& each : path.empty() ? names : std::vector<std::string>{path}) {
            std::string error;
            if (void* handle = open_library(each, error)) return find_all(handle, each);
            if (why.empty()) why = error;
        }
        throw DriverError("library-missing", advice + " (" + why + ")");
    }

private:
    void find_all(void* handle, const std::string& found) {
        for (const auto& [name, address] : wanted)
            if (!(*address = find_symbol(handle, name)))
                throw DriverError("wrong-version",
                                  found + " has no function " + name +
                                      ": it is another library or too old a version; install a newer one");
    }
};

} // namespace palpate
