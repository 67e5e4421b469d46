#include "compliance/load_history.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double negligible = 1e-7; // of the largest load of a node: from there on it is forgotten

double size_of(const double (*value)[3], int fields) {
    double sum = 0;
    for (int j = 0; j < fields; j++)
        for (int c = 0; c < 3; c++) sum += std::abs(value[j][c]);
    return sum;
}

} // namespace

LoadHistory::LoadHistory(const FactoredStiffness& stiffness, const LoadRecursion& recursion)
    : recursion(recursion), stiffness(stiffness), slot(stiffness.vertices(), -1) {
    node.reserve(capacity);
    contact.reserve(ContactPatch::capacity);
    entering.reserve(ContactPatch::capacity);
}

void LoadHistory::reset() {
    for (const Node& n : node) slot[n.vertex] = -1;
    node.clear();
    contact.clear();
    peak = direct_product = 0;
    for (auto& row : product) std::fill_n(row, max_fields, 0.0);
}

bool LoadHistory::enter(GreensFunctions* const* greens, const int* vertices, int count, bool may_read) {
    entering.clear();
    size_t old = 0;
    bool known = true;
    for (int i = 0; i < count; i++) {
        while (old < contact.size() && contact[old].vertex < vertices[i]) old++;
        if (old < contact.size() && contact[old].vertex == vertices[i]) {
            entering.push_back(contact[old]);
        } else {
            entering.emplace_back();
            entering.back().vertex = vertices[i];
            entering.back().known = node.empty();
        }
        known = known && entering.back().known;
    }
    std::swap(contact, entering);
    return known || (may_read && read_fields(greens));
}

// The sums over the history at the vertices that are not known; false, and nothing has changed, if a block is missing.
bool LoadHistory::read_fields(GreensFunctions* const* greens) {
    bool all = true;
    entering.assign(contact.begin(), contact.end());
    for (int s = 0; s < recursion.samples; s++) greens[s]->begin_read();
    for (Node& at : entering)
        if (all && !at.known) read_field(greens, at, all);
    for (int s = 0; s < recursion.samples; s++) greens[s]->end_read();
    if (all) std::swap(contact, entering);
    return all;
}

void LoadHistory::read_field(GreensFunctions* const* greens, Node& at, bool& all) const {
    constexpr int batch = 64;
    GreensFunctions::BlockRequest request[batch];
    float block[9 * batch];
    std::fill_n(&at.value[0][0], 3 * max_fields, 0.0);
    for (size_t first = 0; first < node.size() && all; first += batch) {
        const int count = int(std::min<size_t>(batch, node.size() - first));
        for (int s = 0; s < recursion.samples; s++) {
            for (int k = 0; k < count; k++) request[k] = {at.vertex, node[first + k].vertex, &block[9 * k], false};
            greens[s]->read(request, count);
            for (int k = 0; k < count; k++) {
                all = all && request[k].found;
                for (int j = 0; j < recursion.fields; j++)
                    for (int c = 0; c < 9; c++)
                        at.value[j][c / 3] +=
                            recursion.mix[j][s] * (block[9 * k + c] * node[first + k].value[j][c % 3]);
            }
        }
    }
    at.known = true;
}

void LoadHistory::free_displacement(int i, double out[3]) const {
    for (int c = 0; c < 3; c++) {
        out[c] = 0;
        for (int k = 0; k < recursion.fields; k++)
            for (int j = 0; j < recursion.fields && recursion.shown[k] != 0; j++)
                out[c] += recursion.shown[k] * recursion.step[k][j] * contact[i].value[j][c];
    }
}

void LoadHistory::displacement(int i, double out[3]) const {
    for (int c = 0; c < 3; c++) {
        out[c] = contact[i].direct[c];
        for (int k = 0; k < recursion.fields; k++) out[c] += recursion.shown[k] * contact[i].value[k][c];
    }
}

void LoadHistory::acting_load(int k, int sample, double out[3]) const {
    for (int c = 0; c < 3; c++) {
        out[c] = recursion.direct[sample] * node[k].direct[c];
        for (int j = 0; j < recursion.fields; j++)
            out[c] += recursion.shown[j] * recursion.mix[j][sample] * node[k].value[j][c];
    }
}

void LoadHistory::advance_node(Node& n, const double (*driver)[3]) const {
    const int fields = recursion.fields;
    for (int c = 0; c < 3; c++) {
        double next[max_fields];
        for (int k = 0; k < fields; k++) {
            next[k] = recursion.drive[k] * driver[k][c];
            for (int j = 0; j < fields; j++) next[k] += recursion.step[k][j] * n.value[j][c];
        }
        for (int k = 0; k < fields; k++) n.value[k][c] = next[k];
    }
}

// C_k f of each field at the contact's vertex i, and what f moves it without delay.
void LoadHistory::drive(int i, const double* elastic, double (*out)[3], double direct[3]) const {
    const size_t stride = 3 * contact.size();
    std::fill_n(&out[0][0], 3 * recursion.fields, 0.0);
    std::fill_n(direct, 3, 0.0);
    for (int s = 0; s < recursion.samples; s++)
        for (int c = 0; c < 3; c++) {
            const double moved = elastic[stride * s + 3 * i + c];
            direct[c] += recursion.direct[s] * moved;
            for (int k = 0; k < recursion.fields; k++) out[k][c] += recursion.mix[k][s] * moved;
        }
}

void LoadHistory::advance(const double* load, const double* elastic, bool known) {
    advance_products(load, elastic);
    for (size_t i = 0; i < contact.size(); i++) {
        double driver[max_fields][3];
        drive(int(i), elastic, driver, contact[i].direct);
        advance_node(contact[i], driver);
        contact[i].known = known;
    }
    advance_loads(load);
}

// With x' = S x + b f the products become S Q S' + (S X) b' + b (S X)' + b b' s, where X_j = x_j' C f and s = f' C f.
void LoadHistory::advance_products(const double* load, const double* elastic) {
    const int fields = recursion.fields;
    double with_load[max_fields] = {}, square[max_fields] = {};
    direct_product = 0;
    for (size_t i = 0; i < contact.size(); i++) {
        double driver[max_fields][3], direct[3];
        drive(int(i), elastic, driver, direct);
        for (int c = 0; c < 3; c++) {
            direct_product += load[3 * i + c] * direct[c];
            for (int j = 0; j < fields; j++) {
                square[j] += load[3 * i + c] * driver[j][c];
                with_load[j] += contact[i].value[j][c] * load[3 * i + c];
            }
        }
    }
    double stepped[max_fields] = {}, half[max_fields][max_fields] = {};
    for (int k = 0; k < fields; k++)
        for (int j = 0; j < fields; j++) {
            stepped[k] += recursion.step[k][j] * with_load[j];
            for (int m = 0; m < fields; m++) half[k][m] += recursion.step[k][j] * product[j][m];
        }
    for (int k = 0; k < fields; k++)
        for (int m = 0; m < fields; m++) {
            product[k][m] = stepped[k] * recursion.drive[m] + recursion.drive[k] * stepped[m] +
                            recursion.drive[k] * recursion.drive[m] * square[m];
            for (int j = 0; j < fields; j++) product[k][m] += half[k][j] * recursion.step[m][j];
        }
}

void LoadHistory::advance_loads(const double* load) {
    for (const Node& at : contact) history_of(at.vertex);
    for (Node& n : node) {
        const int i = place_in_contact(n.vertex);
        double driver[max_fields][3] = {};
        for (int c = 0; c < 3; c++) {
            n.direct[c] = i >= 0 ? load[3 * i + c] : 0;
            for (int k = 0; k < recursion.fields; k++) driver[k][c] = n.direct[c];
        }
        advance_node(n, driver);
        peak = std::max(peak, size_of(n.value, recursion.samples > 1 ? recursion.fields : 1));
    }
    for (int k = size() - 1; k >= 0; k--)
        if (!touched(k) && size_of(node[k].value, recursion.fields) < negligible * peak) drop(k);
}

int LoadHistory::place_in_contact(int vertex) const {
    const auto at =
        std::lower_bound(contact.begin(), contact.end(), vertex, [](const Node& n, int v) { return n.vertex < v; });
    return at != contact.end() && at->vertex == vertex ? int(at - contact.begin()) : -1;
}

bool LoadHistory::touched(int k) const { return place_in_contact(node[k].vertex) >= 0; }

LoadHistory::Node& LoadHistory::history_of(int vertex) {
    if (slot[vertex] >= 0) return node[slot[vertex]];
    if (size() == capacity) merge_least();
    slot[vertex] = size();
    node.emplace_back();
    node.back().vertex = vertex;
    return node.back();
}

// What acts somewhat beside its place acts nearly alike.
void LoadHistory::merge_least() {
    const int fields = recursion.fields;
    int least = -1, nearest = -1;
    for (int k = 0; k < size(); k++) {
        if (!touched(k) && (least < 0 || size_of(node[k].value, fields) < size_of(node[least].value, fields)))
            least = k;
    }
    if (least < 0) throw std::logic_error("LoadHistory: a contact larger than its capacity");
    for (int k = 0; k < size(); k++)
        if (k != least && (nearest < 0 || stiffness.distance(vertex(k), vertex(least)) <
                                              stiffness.distance(vertex(nearest), vertex(least))))
            nearest = k;
    for (int j = 0; j < fields; j++)
        for (int c = 0; c < 3; c++) node[nearest].value[j][c] += node[least].value[j][c];
    drop(least);
}

void LoadHistory::drop(int k) {
    slot[node[k].vertex] = -1;
    node[k] = node.back();
    if (k + 1 < size()) slot[node[k].vertex] = k;
    node.pop_back();
}

double LoadHistory::energy() const {
    double sum = 0;
    for (int k = 0; k < recursion.fields; k++) sum += product[k][k] / recursion.share[k];
    return 0.5 * (std::max(sum, 0.0) + direct_product);
}

size_t LoadHistory::most_numbers() const {
    const size_t fields = recursion.fields;
    return (capacity + ContactPatch::capacity) * (4 + 3 * fields) + 2 + fields * fields;
}

void LoadHistory::append_to(std::vector<double>& numbers) const {
    const int fields = recursion.fields;
    for (const auto* list : {&node, &contact})
        for (const Node& n : *list) {
            numbers.push_back(n.vertex + (n.known ? 0 : 0.5));
            numbers.insert(numbers.end(), &n.value[0][0], &n.value[0][0] + 3 * fields);
            if (recursion.samples > 1) numbers.insert(numbers.end(), n.direct, n.direct + 3);
        }
    numbers.push_back(peak);
    if (recursion.samples > 1) numbers.push_back(direct_product);
    for (int k = 0; k < fields; k++) numbers.insert(numbers.end(), product[k], product[k] + fields);
}

} // namespace palpate
