#include "net/json_reader.h"
#include <cmath>
#include <doctest.h>
#include <string>

using palpate::JsonReader;

TEST_CASE("values are found by member and element, with any space between them") {
    const JsonReader all(" {\"a\" : [ 1 , {\"b\":\"x\\\"y\"}, true ] , \"c\":-2.5e-3} ");
    CHECK(all["a"][0].number(0) == 1);
    CHECK(all["a"][1]["b"].string() == "x\\\"y"); // escapes stay as written
    CHECK(all["a"][2].is_true());
    CHECK(all["c"].number(0) == doctest::Approx(-0.0025).epsilon(1e-15));
}

TEST_CASE("what is missing or of another type is empty") {
    const JsonReader all("{\"a\":[1],\"b\":\"text\"}");
    for (const JsonReader& none : {all["x"], all["a"][1], all["a"]["b"], all["b"][0], all[0]}) CHECK(!none.exists());
    CHECK(std::isnan(all["b"].number(NAN)));
    CHECK(all["a"].string().empty());
}

TEST_CASE("malformed messages are empty") {
    for (const char* text : {"", "{", "{\"a\":1", "[1}", "\"open", "{\"a\":1} 2", "]"})
        CHECK(!JsonReader(text).exists());
    CHECK(!JsonReader(std::string(100000, '[')).exists());
    for (const char* number : {"-", "1.2.3", "1e", "0x1", "nan"}) CHECK(std::isnan(JsonReader(number).number(NAN)));
}
