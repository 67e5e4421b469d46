#include "net/sha1.h"
#include "net/websocket_client.h"
#include <doctest.h>

TEST_CASE("the handshake's answer is that of RFC 6455, section 1.3") {
    CHECK(palpate::websocket_accept("dGhlIHNhbXBsZSBub25jZQ==") == "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
}

TEST_CASE("SHA-1 of one and two blocks is that of FIPS 180-4's examples") {
    const std::string two = "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq";
    CHECK(palpate::base64(palpate::sha1("abc")) == "qZk+NkcGgWq6PiVxeFDCbJzQ2J0=");
    CHECK(palpate::base64(palpate::sha1(two)) == "hJg+RBw70m66rkqh+VEp5eVGcPE=");
}
