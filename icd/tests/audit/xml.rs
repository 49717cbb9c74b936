//! Elements of `vk.xml`.

use roxmltree::Node;

/// Whether an element is of Vulkan, not only of Vulkan SC.
pub fn is_vulkan(node: Node<'_, '_>) -> bool {
    let apis = node.attribute("api").unwrap_or("vulkan");
    apis.split(',')
        .any(|api| api == "vulkan" || api == "vulkanbase")
}

/// The children of a node with a tag, of Vulkan.
pub fn elements<'a, 'input: 'a>(
    node: Node<'a, 'input>,
    tag: &'static str,
) -> impl Iterator<Item = Node<'a, 'input>> {
    node.children()
        .filter(move |child| child.has_tag_name(tag) && is_vulkan(*child))
}

/// The text of the first child with a tag.
pub fn child_text<'a>(node: Node<'a, '_>, tag: &'static str) -> Option<&'a str> {
    node.children()
        .find(|child| child.has_tag_name(tag))?
        .text()
}
