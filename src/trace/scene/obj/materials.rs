//! The materials of a scene by name, and the names by which faces use them.

use std::collections::HashMap;

use crate::scene::Material;
use crate::scene::cursor::Token;

/// What the libraries define. Names are bytes: files are in any encoding.
#[derive(Default)]
pub(super) struct Materials {
    list: Vec<Material>,
    by_name: HashMap<Vec<u8>, u32>,
    /// Those that end in what may be a comment, without it.
    by_name_without_comment: HashMap<Vec<u8>, u32>,
}

impl Materials {
    pub(super) fn is_defined(&self, name: Token) -> bool {
        self.by_name.contains_key(name.bytes)
    }

    /// Adds a material whose name is new.
    pub(super) fn define(&mut self, name: Token, material: Material) {
        let id = self.count();
        self.list.push(material);
        self.by_name.insert(name.bytes.to_vec(), id);
        let cut = name.without_comment();
        if cut.bytes.len() < name.bytes.len() {
            self.by_name_without_comment.entry(cut.bytes.to_vec()).or_insert(id);
        }
    }

    /// The material of a name: as it is written, or else without comments.
    fn find(&self, name: Token) -> Option<u32> {
        let names = [name.bytes, name.without_comment().bytes];
        let maps = [&self.by_name, &self.by_name_without_comment];
        maps.into_iter().flat_map(|map| names.map(|name| map.get(name))).find_map(Option::<&u32>::copied)
    }

    /// A library takes nine bytes per material, and all have some millions: there are fewer than 2³².
    pub(super) fn count(&self) -> u32 {
        self.list.len() as u32
    }

    pub(super) fn into_list(self) -> Vec<Material> {
        self.list
    }
}

/// The names after `usemtl`. They are resolved when the whole file is read, so that libraries may come late.
#[derive(Default)]
pub(super) struct Uses<'a> {
    ids: HashMap<&'a [u8], u32>,
    /// The first place of each name, and how often it is used.
    names: Vec<(Token<'a>, u64)>,
    current: u32,
}

impl<'a> Uses<'a> {
    /// What follows is of this material; of none when the name is empty.
    pub(super) fn add(&mut self, name: Token<'a>) {
        if name.bytes.is_empty() {
            self.current = 0;
            return;
        }
        self.current = *self.ids.entry(name.bytes).or_insert(self.names.len() as u32 + 1);
        match self.names.get_mut(self.current as usize - 1) {
            Some((_, count)) => *count += 1,
            None => self.names.push((name, 1)),
        }
    }

    /// From 0, which is no material.
    pub(super) fn current(&self) -> u32 {
        self.current
    }

    /// The materials of all uses, by the number that was the current one; `white` is of those that are not there,
    /// each of which `undefined` gets.
    pub(super) fn resolve(&self, materials: &Materials, white: u32, mut undefined: impl FnMut(Token)) -> Vec<u32> {
        let mut resolved = vec![white];
        for &(name, count) in &self.names {
            let found = materials.find(name);
            if found.is_none() {
                (0..count).for_each(|_| undefined(name));
            }
            resolved.push(found.unwrap_or(white));
        }
        resolved
    }
}
