//! A page as a browser parses it: its tree, a few selectors, and its parse errors.

use html5ever::tendril::{StrTendril, TendrilSink};
use html5ever::tree_builder::{ElementFlags, NodeOrText, QuirksMode, TreeSink};
use html5ever::{Attribute, ExpandedName, QualName, parse_document};
use std::borrow::Cow;
use std::cell::RefCell;
use std::rc::{Rc, Weak};

/// A page and its parse errors.
pub(super) struct Page {
    document: Rc<Node>,
    pub(super) errors: Vec<String>,
}

/// An element, a text, or a node with neither name nor text (the document and comments).
#[derive(Default)]
pub(super) struct Node {
    name: Option<QualName>,
    attributes: RefCell<Vec<Attribute>>,
    text: RefCell<Option<String>>,
    parent: RefCell<Weak<Node>>,
    children: RefCell<Vec<Rc<Node>>>,
}

impl Page {
    pub(super) fn parse(html: &str) -> Self {
        let sink = Sink {
            document: Rc::default(),
            errors: RefCell::default(),
        };
        parse_document(sink, html5ever::ParseOpts::default()).one(html)
    }

    /// The elements that match a selector, in document order. A selector consists of names, `#id`,
    /// `.class`, `[attribute]` and `[attribute='value']`; a space stands for any descendant.
    pub(super) fn select(&self, selector: &str) -> Vec<Rc<Node>> {
        let steps: Vec<&str> = selector.split(' ').collect();
        let mut found = Vec::new();
        self.document.collect(&steps, &mut found);
        found
    }
}

impl Node {
    pub(super) fn attribute(&self, name: &str) -> Option<String> {
        let attributes = self.attributes.borrow();
        let attribute = attributes
            .iter()
            .find(|attribute| &*attribute.name.local == name)?;
        Some(attribute.value.to_string())
    }

    /// All text inside, with single spaces.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        self.collect_text(&mut text);
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    fn collect_text(&self, out: &mut String) {
        if let Some(text) = &*self.text.borrow() {
            out.push_str(text);
            out.push(' ');
        }
        for child in &*self.children.borrow() {
            child.collect_text(out);
        }
    }

    fn collect(self: &Rc<Self>, steps: &[&str], found: &mut Vec<Rc<Self>>) {
        if self.is_at(steps) {
            found.push(self.clone());
        }
        for child in &*self.children.borrow() {
            child.collect(steps, found);
        }
    }

    fn is_at(&self, steps: &[&str]) -> bool {
        let Some((last, above)) = steps.split_last() else {
            return true;
        };
        let ancestor_is_at = |node: &Self| {
            let mut ancestor = node.parent.borrow().upgrade();
            while let Some(node) = ancestor {
                if node.is_at(above) {
                    return true;
                }
                ancestor = node.parent.borrow().upgrade();
            }
            false
        };
        self.is(last) && (above.is_empty() || ancestor_is_at(self))
    }

    fn is(&self, step: &str) -> bool {
        let marks = ['#', '.', '['];
        let (tag, mut rest) = step.split_at(step.find(marks).unwrap_or(step.len()));
        let Some(name) = &self.name else { return false };
        if !tag.is_empty() && &*name.local != tag {
            return false;
        }
        while let Some(mark) = rest.chars().next() {
            let (part, after) = rest[1..].split_at(rest[1..].find(marks).unwrap_or(rest.len() - 1));
            rest = after;
            let has = match mark {
                '#' => self.attribute("id").is_some_and(|id| id == part),
                '.' => self
                    .attribute("class")
                    .is_some_and(|class| class.split_whitespace().any(|word| word == part)),
                _ => {
                    let part = part.strip_suffix(']').expect("an attribute ends in ]");
                    match part.split_once('=') {
                        None => self.attribute(part).is_some(),
                        Some((name, value)) => {
                            self.attribute(name).as_deref() == Some(value.trim_matches('\''))
                        }
                    }
                }
            };
            if !has {
                return false;
            }
        }
        true
    }

    fn detach(&self) {
        if let Some(parent) = self.parent.take().upgrade() {
            parent
                .children
                .borrow_mut()
                .retain(|child| !std::ptr::eq(&raw const **child, self));
        }
    }

    /// Inserts a child; text is merged with preceding text.
    fn insert(self: &Rc<Self>, place: usize, child: NodeOrText<Rc<Self>>) {
        let child = match child {
            NodeOrText::AppendNode(node) => {
                node.detach();
                node
            }
            NodeOrText::AppendText(text) => {
                let children = self.children.borrow();
                let before = place.checked_sub(1).map(|before| &children[before]);
                if let Some(before) = before
                    && let Some(existing) = &mut *before.text.borrow_mut()
                {
                    existing.push_str(&text);
                    return;
                }
                Rc::new(Self {
                    text: RefCell::new(Some(text.to_string())),
                    ..Self::default()
                })
            }
        };
        *child.parent.borrow_mut() = Rc::downgrade(self);
        self.children.borrow_mut().insert(place, child);
    }
}

/// The sink from which the parser builds the tree.
struct Sink {
    document: Rc<Node>,
    errors: RefCell<Vec<String>>,
}

impl TreeSink for Sink {
    type Handle = Rc<Node>;
    type Output = Page;
    type ElemName<'a> = ExpandedName<'a>;

    fn finish(self) -> Page {
        Page {
            document: self.document,
            errors: self.errors.into_inner(),
        }
    }

    fn parse_error(&self, message: Cow<'static, str>) {
        self.errors.borrow_mut().push(message.into_owned());
    }

    fn get_document(&self) -> Rc<Node> {
        self.document.clone()
    }

    fn elem_name<'a>(&'a self, target: &'a Rc<Node>) -> ExpandedName<'a> {
        target.name.as_ref().expect("elements have names").expanded()
    }

    fn create_element(&self, name: QualName, attributes: Vec<Attribute>, _: ElementFlags) -> Rc<Node> {
        Rc::new(Node {
            name: Some(name),
            attributes: RefCell::new(attributes),
            ..Node::default()
        })
    }

    fn create_comment(&self, _: StrTendril) -> Rc<Node> {
        Rc::default()
    }

    fn create_pi(&self, _: StrTendril, _: StrTendril) -> Rc<Node> {
        Rc::default()
    }

    fn append(&self, parent: &Rc<Node>, child: NodeOrText<Rc<Node>>) {
        let end = parent.children.borrow().len();
        parent.insert(end, child);
    }

    fn append_based_on_parent_node(
        &self,
        element: &Rc<Node>,
        before: &Rc<Node>,
        child: NodeOrText<Rc<Node>>,
    ) {
        if element.parent.borrow().upgrade().is_some() {
            self.append_before_sibling(element, child);
        } else {
            self.append(before, child);
        }
    }

    fn append_doctype_to_document(&self, _: StrTendril, _: StrTendril, _: StrTendril) {}

    fn get_template_contents(&self, target: &Rc<Node>) -> Rc<Node> {
        target.clone()
    }

    fn same_node(&self, x: &Rc<Node>, y: &Rc<Node>) -> bool {
        Rc::ptr_eq(x, y)
    }

    fn set_quirks_mode(&self, _: QuirksMode) {}

    fn append_before_sibling(&self, sibling: &Rc<Node>, child: NodeOrText<Rc<Node>>) {
        if let NodeOrText::AppendNode(node) = &child {
            node.detach();
        }
        let parent = sibling.parent.borrow().upgrade();
        let parent = parent.expect("a sibling has a parent");
        let place = parent
            .children
            .borrow()
            .iter()
            .position(|node| Rc::ptr_eq(node, sibling));
        parent.insert(place.expect("a parent has its children"), child);
    }

    fn add_attrs_if_missing(&self, target: &Rc<Node>, attributes: Vec<Attribute>) {
        let mut found = target.attributes.borrow_mut();
        for attribute in attributes {
            if !found.iter().any(|known| known.name == attribute.name) {
                found.push(attribute);
            }
        }
    }

    fn remove_from_parent(&self, target: &Rc<Node>) {
        target.detach();
    }

    fn reparent_children(&self, node: &Rc<Node>, parent: &Rc<Node>) {
        let children = node.children.borrow().clone();
        for child in children {
            self.append(parent, NodeOrText::AppendNode(child));
        }
    }
}
