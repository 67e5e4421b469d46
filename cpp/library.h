#pragma once
#include "driver.h"
#include <dlfcn.h>
#include <string>
#include <vector>

namespace palpate {

// A maker's library, found at run time: never shipped, never linked. It stays loaded, since its threads may outlive us.
class Library {
    void* handle = nullptr;
    std::string found;

public:
    // Tries `path` alone, or each of `names` where the loader looks.
    void load(const std::string& path, const std::vector<std::string>& names, const std::string& advice) {
        std::string why;
        for (const auto& each : path.empty() ? names : std::vector<std::string>{path}) {
            if ((handle = dlopen(each.c_str(), RTLD_NOW | RTLD_LOCAL))) {
                found = each;
                return;
            }
            const char* said = dlerror();
            if (why.empty()) why = said ? said : each;
        }
        throw DriverError("library-missing", advice + " (" + why + ")");
    }

    template <class F> void symbol(F& function, const char* name) {
        function = reinterpret_cast<F>(dlsym(handle, name));
        if (!function)
            throw DriverError("wrong-version", found + " has no function " + name +
                                                   ": it is another library or too old a version; install a newer one");
    }
};

} // namespace palpate
