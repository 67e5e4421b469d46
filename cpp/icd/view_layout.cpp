#include "icd/view_layout.h"

namespace palpate {

ViewLayout::ViewLayout(const View& view) {
    separable = view.orientation == PanelOrientation::parallel ||
                (view.orientation == PanelOrientation::rotated && !view.swapped);
    if (separable) {
        rows = view.swapped ? view.na : view.nb;
        columns = view.swapped ? view.nb : view.na;
        start = view.start;
        down = view.swapped ? view.step_a : view.step_b;
        right = view.swapped ? view.step_b : view.step_a;
        stride = columns + column_padding;
    } else {
        rows = view.panel.rows;
        columns = view.panel.columns;
        start = 0;
        down = stride = columns;
        right = 1;
    }
}

} // namespace palpate
