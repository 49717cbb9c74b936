//! Which file of a crate uses which other one, and the circles of files that use each other.
//!
//! A path is followed through imports and re-exports to the file that defines what it names. So a
//! `pub use` is no use of a file, and a type that lies elsewhere counts where it lies. A folder's
//! own file (`mod.rs`, `lib.rs`, `main.rs` or the file of the folder's name) holds what its files
//! share and calls them: its use of them does not count. Tests (`#[cfg(test)]`) may use what they
//! like. Method calls name no file.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Spacing, TokenStream, TokenTree};
use syn::ext::IdentExt;
use syn::punctuated::Punctuated;
use syn::visit::{self, Visit};

use crate::{collect, module_of};

/// A module's path from the crate's root.
type Module = Vec<String>;

/// The definitions and imports of a module.
#[derive(Default)]
struct Scope {
    /// The file it stands in, by its number.
    file: usize,
    items: BTreeSet<String>,
    /// The path of a name, as written.
    imports: BTreeMap<String, Vec<String>>,
    globs: Vec<Vec<String>>,
    /// The paths that its code names.
    uses: BTreeSet<Vec<String>>,
}

/// The files of a crate with the names that each takes from each other one.
pub struct Files {
    pub paths: Vec<PathBuf>,
    pub arrows: BTreeMap<(usize, usize), BTreeSet<String>>,
}

impl Files {
    pub fn read(source: &Path) -> Self {
        let mut paths = Vec::new();
        collect(source, &mut paths);
        paths.sort();
        let mut reader = Reader::default();
        for (number, path) in paths.iter_mut().enumerate() {
            let text = fs::read_to_string(&*path).expect("a source file can be read");
            *path = path
                .strip_prefix(source)
                .expect("found below the folder")
                .to_path_buf();
            reader.module = module_of(path);
            reader.scope().file = number;
            reader.visit_file(&syn::parse_file(&text).expect("a source file can be parsed"));
        }
        let Reader { scopes, tests, .. } = reader;
        let is_test = |module: &[String]| (0..=module.len()).any(|n| tests.contains(&module[..n]));
        let mut arrows: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
        for (module, scope) in &scopes {
            if is_test(module) {
                continue;
            }
            for path in &scope.uses {
                if let Some(file) = resolve(&scopes, module, path, 0)
                    && file != scope.file
                    && !lies_under(&paths[file], &paths[scope.file])
                {
                    let name = path.last().expect("a path has a name").clone();
                    arrows.entry((scope.file, file)).or_default().insert(name);
                }
            }
        }
        Self { paths, arrows }
    }

    /// The sets of more than one file in which each leads to each other one.
    pub fn circles(&self) -> Vec<Vec<usize>> {
        let mut next = vec![Vec::new(); self.paths.len()];
        for (from, to) in self.arrows.keys() {
            next[*from].push(*to);
        }
        let reached: Vec<BTreeSet<usize>> = (0..next.len())
            .map(|start| {
                let mut seen = BTreeSet::new();
                let mut open = next[start].clone();
                while let Some(file) = open.pop() {
                    if seen.insert(file) {
                        open.extend(&next[file]);
                    }
                }
                seen
            })
            .collect();
        let mut done: BTreeSet<usize> = BTreeSet::new();
        let mut circles = Vec::new();
        for file in 0..next.len() {
            if !reached[file].contains(&file) || done.contains(&file) {
                continue;
            }
            let circle = reached[file].iter().copied();
            let circle: Vec<_> = circle
                .filter(|&other| reached[other].contains(&file))
                .collect();
            done.extend(&circle);
            circles.push(circle);
        }
        circles
    }

    /// A circle in words: each arrow inside it, with the names that make it.
    pub fn describe(&self, circle: &[usize]) -> String {
        let inside = |file: &usize| circle.contains(file);
        let arrows = self.arrows.iter();
        let arrows = arrows.filter(|((from, to), _)| inside(from) && inside(to));
        let lines = arrows.map(|((from, to), names)| {
            let (from, to) = (self.paths[*from].display(), self.paths[*to].display());
            format!("    {from} -> {to}: {names:?}\n")
        });
        format!("  {} files:\n{}", circle.len(), lines.collect::<String>())
    }
}

/// Whether a file lies in the folder whose own file is `face`.
fn lies_under(file: &Path, face: &Path) -> bool {
    let is_inside = |name| face.ends_with(name);
    let folder = match ["mod.rs", "lib.rs", "main.rs"].into_iter().any(is_inside) {
        true => face
            .parent()
            .expect("a file lies in a folder")
            .to_path_buf(),
        false => face.with_extension(""),
    };
    file.starts_with(folder)
}

/// The file that defines what `path`, written in `module`, names; none outside the crate, and none
/// where a path names a module only.
fn resolve(
    scopes: &BTreeMap<Module, Scope>,
    module: &[String],
    path: &[String],
    depth: usize,
) -> Option<usize> {
    if depth > 16 {
        return None;
    }
    let mut at = module.to_vec();
    let mut rest = path;
    let mut inside = false;
    while let Some((first, behind)) = rest.split_first() {
        match first.as_str() {
            "crate" => at.clear(),
            "self" => {}
            "super" => drop(at.pop()),
            _ => break,
        }
        inside = true;
        rest = behind;
    }
    while let Some((first, behind)) = rest.split_first() {
        let scope = scopes.get(&at)?;
        let mut inner = at.clone();
        inner.push(first.clone());
        // A path that ends with the name of a module and of an item, defined or re-exported, names
        // the item.
        let is_item = scope.items.contains(first) || scope.imports.contains_key(first);
        if scopes.contains_key(&inner) && !(behind.is_empty() && is_item) {
            at = inner;
            rest = behind;
            inside = true;
            continue;
        }
        if scope.items.contains(first) {
            return Some(scope.file);
        }
        if let Some(import) = scope.imports.get(first) {
            if import.as_slice() == [first.clone()] {
                return None;
            }
            let through = [import, behind].concat();
            return resolve(scopes, &at, &through, depth + 1);
        }
        // A glob of another crate brings no name of this one.
        let is_own = |glob: &&Vec<String>| {
            let first = &glob[0];
            let module = [at.as_slice(), std::slice::from_ref(first)].concat();
            matches!(first.as_str(), "crate" | "self" | "super")
                || scopes.contains_key(&module)
                || scope.items.contains(first)
                || scope.imports.contains_key(first)
        };
        let mut globs = scope.globs.iter().filter(is_own);
        let found = globs.find_map(|glob| {
            let through = [glob.as_slice(), rest].concat();
            resolve(scopes, &at, &through, depth + 1)
        });
        // A name that a macro of the module makes lies in the module.
        return found.or((inside && depth == 0).then_some(scope.file));
    }
    None
}

/// Gathers the scopes of a crate.
#[derive(Default)]
struct Reader {
    module: Module,
    scopes: BTreeMap<Module, Scope>,
    /// Modules that only tests have.
    tests: BTreeSet<Module>,
}

impl Reader {
    fn scope(&mut self) -> &mut Scope {
        self.scopes.entry(self.module.clone()).or_default()
    }

    fn note_tree(&mut self, before: &[String], tree: &syn::UseTree) {
        let with = |ident: &syn::Ident| [before, &[ident.unraw().to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.note_tree(&with(&path.ident), &path.tree),
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.note_tree(before, tree);
                }
            }
            syn::UseTree::Name(syn::UseName { ident }) if ident == "self" => {
                let name = before.last().expect("`self` stands behind a path").clone();
                self.scope().imports.insert(name, before.to_vec());
            }
            syn::UseTree::Name(syn::UseName { ident }) => {
                let name = ident.unraw().to_string();
                self.scope().imports.insert(name, with(ident));
            }
            syn::UseTree::Rename(syn::UseRename { ident, rename, .. }) => {
                let name = rename.unraw().to_string();
                self.scope().imports.insert(name, with(ident));
            }
            syn::UseTree::Glob(_) => self.scope().globs.push(before.to_vec()),
        }
    }

    /// Paths in a macro's tokens.
    fn note_tokens(&mut self, tokens: TokenStream) {
        let mut path = Vec::new();
        let mut joints = 0;
        for tree in tokens {
            match tree {
                TokenTree::Ident(ident) => {
                    if joints != 2 {
                        self.note(std::mem::take(&mut path));
                    }
                    path.push(ident.unraw().to_string());
                    joints = 0;
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' => {
                    joints += 1;
                    if joints == 1 && punct.spacing() == Spacing::Alone {
                        self.note(std::mem::take(&mut path));
                    }
                }
                TokenTree::Group(group) => {
                    self.note(std::mem::take(&mut path));
                    joints = 0;
                    self.note_tokens(group.stream());
                }
                _ => {
                    self.note(std::mem::take(&mut path));
                    joints = 0;
                }
            }
        }
        self.note(path);
    }

    fn note(&mut self, path: Vec<String>) {
        if !path.is_empty() {
            self.scope().uses.insert(path);
        }
    }
}

/// Whether only tests have an item.
fn is_test(attributes: &[syn::Attribute]) -> bool {
    let mut attributes = attributes.iter();
    attributes.any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute
                .parse_args()
                .is_ok_and(|condition: syn::Meta| match &condition {
                    syn::Meta::List(list) if list.path.is_ident("all") => {
                        let all = Punctuated::<syn::Meta, syn::Token![,]>::parse_terminated;
                        (list.parse_args_with(all))
                            .is_ok_and(|all| all.iter().any(|one| one.path().is_ident("test")))
                    }
                    condition => condition.path().is_ident("test"),
                })
    })
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        self.module.push(module.ident.unraw().to_string());
        if is_test(&module.attrs) {
            self.tests.insert(self.module.clone());
        } else if let Some((_, items)) = &module.content {
            let file = {
                let outer = &self.module[..self.module.len() - 1];
                self.scopes[outer].file
            };
            self.scope().file = file;
            for item in items {
                self.visit_item(item);
            }
        }
        self.module.pop();
    }

    fn visit_item(&mut self, item: &'ast syn::Item) {
        let (name, attributes) = match item {
            syn::Item::Const(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Enum(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Fn(item) => (Some(&item.sig.ident), &item.attrs),
            syn::Item::Macro(item) => (item.ident.as_ref(), &item.attrs),
            syn::Item::Static(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Struct(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Trait(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Type(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Union(item) => (Some(&item.ident), &item.attrs),
            syn::Item::Use(item) => (None, &item.attrs),
            syn::Item::Impl(item) => (None, &item.attrs),
            _ => return visit::visit_item(self, item),
        };
        if is_test(attributes) {
            return;
        }
        if let Some(name) = name {
            let name = name.unraw().to_string();
            self.scope().items.insert(name);
        }
        visit::visit_item(self, item);
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.note_tree(&[], &item.tree);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments = path.segments.iter();
        self.note(
            segments
                .map(|segment| segment.ident.unraw().to_string())
                .collect(),
        );
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, mac: &'ast syn::Macro) {
        self.visit_path(&mac.path);
        self.note_tokens(mac.tokens.clone());
    }
}
