//! What the specification of OBJ knows, and a scene does not hold.

/// A statement that has no effect.
pub(super) struct Undrawn {
    keywords: &'static [&'static [u8]],
    /// Of its warning.
    pub(super) kind: &'static str,
    pub(super) text: &'static str,
    /// Whether `off` or 0 is a value of it, and no loss.
    pub(super) is_attribute: bool,
}

const UNDRAWN: [Undrawn; 7] = [
    Undrawn { keywords: &[b"l"], kind: "lines", text: "lines are not drawn", is_attribute: false },
    Undrawn { keywords: &[b"p"], kind: "points", text: "points are not drawn", is_attribute: false },
    Undrawn {
        keywords: &[
            b"bmat", b"bsp", b"bzp", b"cdc", b"cdp", b"con", b"cstype", b"ctech", b"curv", b"curv2", b"deg", b"end",
            b"hole", b"mg", b"parm", b"res", b"scrv", b"sp", b"stech", b"step", b"surf", b"trim", b"vp",
        ],
        kind: "free-form",
        text: "free-form curves and surfaces are not drawn, expected faces",
        is_attribute: false,
    },
    Undrawn {
        keywords: &[b"bevel", b"c_interp", b"d_interp", b"lod"],
        kind: "display-attribute",
        text: "this display attribute has no effect",
        is_attribute: true,
    },
    Undrawn {
        keywords: &[b"shadow_obj", b"trace_obj"],
        kind: "shadow-object",
        text: "other objects for shadows or reflections are not read: the scene's own are seen in them",
        is_attribute: false,
    },
    Undrawn {
        keywords: &[b"call", b"csh"],
        kind: "call",
        text: "other files and commands are not called: what they would give is missing",
        is_attribute: false,
    },
    Undrawn {
        keywords: &[b"maplib", b"usemap"],
        kind: "texture-map",
        text: "textures are not drawn, the colour alone is",
        is_attribute: true,
    },
];

/// Keywords that are read.
const READ: [&[u8]; 10] = [b"v", b"vn", b"vt", b"f", b"fo", b"g", b"o", b"s", b"usemtl", b"mtllib"];

pub(super) fn undrawn(keyword: &[u8]) -> Option<&'static Undrawn> {
    UNDRAWN.iter().find(|statement| statement.keywords.contains(&keyword))
}

/// The keyword that a word is but for upper and lower case.
pub(super) fn in_other_letters(word: &[u8]) -> Option<&'static [u8]> {
    let mut known = READ.iter().chain(UNDRAWN.iter().flat_map(|statement| statement.keywords));
    known.find(|keyword| word != **keyword && word.eq_ignore_ascii_case(keyword)).copied()
}
