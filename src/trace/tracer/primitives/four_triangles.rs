//! Triangles side by side, for tests of four at once.

use glam::{Mat4, Vec4};

use crate::database::records::Triangle;

/// Up to four triangles. Where none has been put there is an older one, or one without area.
#[derive(Clone, Debug, Default)]
pub struct FourTriangles {
    /// By triangle, the record's ten words.
    rows: [[Vec4; 3]; 4],
}

impl FourTriangles {
    #[inline(always)]
    pub fn put(&mut self, lane: usize, triangle: &Triangle) {
        let w: [f32; 10] = bytemuck::cast(*triangle);
        self.rows[lane & 3] = [
            Vec4::from_array([w[0], w[1], w[2], w[3]]),
            Vec4::from_array([w[4], w[5], w[6], w[7]]),
            Vec4::from_array([w[8], w[9], 0.0, 0.0]),
        ];
    }

    #[inline(always)]
    pub fn get(&self, lane: usize) -> Triangle {
        let [a, b, c] = self.rows[lane & 3];
        let (a, b, c) = (a.to_array(), b.to_array(), c.to_array());
        let words = [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], c[0], c[1]];
        bytemuck::cast(words)
    }

    /// By axis and vertex.
    #[inline(always)]
    pub(super) fn coordinates(&self) -> [[Vec4; 3]; 3] {
        let [a, b, c, d] = &self.rows;
        let column = |word: usize| {
            let Mat4 { x_axis, y_axis, z_axis, w_axis } =
                Mat4::from_cols(a[word], b[word], c[word], d[word]).transpose();
            [x_axis, y_axis, z_axis, w_axis]
        };
        let ([x0, x1, x2, y0], [y1, y2, z0, z1], [z2, ..]) = (column(0), column(1), column(2));
        [[x0, x1, x2], [y0, y1, y2], [z0, z1, z2]]
    }
}
