use proptest::prelude::*;

use super::*;
use crate::hardware::cluster_memory::{AccessError, ClusterMemory};
use crate::hardware::replacement::{Clock, Fifo, Lru, Random};
use crate::hardware::specification::{self, MemorySize};
use crate::hardware::transaction::FetchRequest;
use ground::ids::Address;
use trace::database::strides::Strides;

/// Records of each section; 40 materials of 48 bytes, and so on.
const RECORDS: [u64; Section::COUNT] = [400, 150, 90, 30, 20, 140, 50, 40, 25];

fn layout() -> Layout {
    Layout::new(RECORDS).expect("small")
}

/// Some sections' records have padding, up to the most that there can be.
fn padded_layout() -> Layout {
    let strides = Strides::new([4, 4, 76, 16, 64, 8, 92, 48, 496]).expect("possible");
    Layout::padded(RECORDS, strides).expect("small")
}

/// A byte's value tells its place well enough that no two lines are equal.
fn image(layout: &Layout) -> Vec<u8> {
    (0..layout.database_bytes() / 4).flat_map(|word| (word as u32).wrapping_mul(0x9E37_79B1).to_le_bytes()).collect()
}

fn cluster_memory(layout: &Layout) -> ClusterMemory {
    let mut memory = ClusterMemory::new(layout);
    memory.store(Address(0), &image(layout)).expect("in order");
    memory
}

/// Counts what is asked of the memory behind it, and fails when told to.
struct Counting<'a> {
    memory: &'a ClusterMemory,
    fetches: u64,
    bytes: u64,
    /// Of the last request.
    accesses_before: u64,
    broken: bool,
}

impl LineSource for Counting<'_> {
    type Error = Option<AccessError>;

    fn fetch(&mut self, request: &FetchRequest, into: &mut [u8]) -> Result<(), Self::Error> {
        if self.broken {
            into.fill(0xEE);
            return Err(None);
        }
        self.fetches += 1;
        self.bytes += into.len() as u64;
        self.accesses_before = request.accesses_before;
        assert_eq!(request.bytes() as usize, into.len());
        self.memory.fetch(request, into).map_err(Some)
    }
}

fn counting<'a, R: Replacement>(
    memory: &'a ClusterMemory,
    layout: &Layout,
    local: specification::LocalMemory,
) -> LocalMemory<R, Counting<'a>> {
    let geometry = Geometry::new(&local, layout).expect("within ranges");
    LocalMemory::new(geometry, layout, 3, Counting { memory, fetches: 0, bytes: 0, accesses_before: 0, broken: false })
}

/// Reads a record as the tracer would, as bytes.
fn read<P: MemoryPort>(port: &mut P, section: Section, index: u32) -> Result<Vec<u8>, P::Error> {
    use bytemuck::bytes_of;
    Ok(match section {
        Section::OctreeNodes => bytes_of(&port.octree_node(index, index % 30)?).to_vec(),
        Section::LeafLists => bytes_of(&port.leaf_entry(index)?).to_vec(),
        Section::Triangles => bytes_of(&port.triangle(index)?).to_vec(),
        Section::Spheres => bytes_of(&port.sphere(index)?).to_vec(),
        Section::Cones => bytes_of(&port.cone(index)?).to_vec(),
        Section::Surfaces => bytes_of(&port.surface(index)?).to_vec(),
        Section::Normals => bytes_of(&port.normals(index)?).to_vec(),
        Section::Materials => bytes_of(&port.material(index)?).to_vec(),
        Section::Polygons => bytes_of(&port.polygon(index)?).to_vec(),
    })
}

fn local(size: MemorySize, line: u32, ways: Option<u32>) -> specification::LocalMemory {
    specification::LocalMemory { size, line, ways, replacement: specification::Replacement::Lru }
}

/// Every record is the image's, and the counts are those of a directory alone given the same lines.
fn check<R: Replacement>(
    layout: &Layout,
    local: specification::LocalMemory,
    reads: &[(usize, u32)],
) -> Result<(), TestCaseError> {
    let (image, cluster_memory) = (image(layout), cluster_memory(layout));
    let mut memory = counting::<R>(&cluster_memory, layout, local);
    let mut directory = Directory::<R>::new(memory.geometry().slots(), memory.geometry().database_lines, 3);
    let (mut expected, mut words) = (Counters::default(), 0);
    for &(section, index) in reads {
        let section = Section::ALL[section];
        let index = index % RECORDS[section as usize] as u32;
        let start = layout.span(section).base.0 + u64::from(index) * layout.record_bytes(section);
        let end = start + layout.record_bytes(section);
        let record = read(&mut memory, section, index).expect("in range");
        prop_assert_eq!(record.len() as u64, section.content_bytes());
        prop_assert_eq!(&record, &image[start as usize..start as usize + record.len()]);
        words += layout.record_bytes(section) / 4;

        let lines = start / u64::from(local.line)..=(end - 1) / u64::from(local.line);
        let missed: Vec<bool> =
            lines.map(|line| matches!(directory.reference(line as u32), Reference::Miss { .. })).collect();
        let line_misses = missed.iter().filter(|&&m| m).count() as u64;
        expected.add(&Counters {
            record_accesses: 1,
            record_misses: u64::from(line_misses > 0),
            line_accesses: missed.len() as u64,
            line_misses,
        });
    }
    let stats = memory.take_stats();
    prop_assert_eq!(stats.total(), expected);
    prop_assert_eq!(stats.words_read(layout), words);
    prop_assert_eq!(memory.source_mut().fetches, expected.record_misses);
    prop_assert_eq!(memory.source_mut().bytes, expected.line_misses * u64::from(local.line));
    prop_assert_eq!(stats.words_moved(local.line) * 4, memory.source_mut().bytes);
    Ok(())
}

proptest! {
    #[test]
    fn records_are_the_images_and_counts_those_of_the_directory(
        shift in 4u32..=8,
        share in 1u32..=40,
        ways in prop::option::of(prop::sample::select(vec![1, 2, 3, 4, 16])),
        reads in prop::collection::vec((0..Section::COUNT, 0u32..400), 0..800),
    ) {
        let local = local(MemorySize::Share { numerator: share, denominator: 40 }, 1 << shift, ways);
        for layout in [layout(), padded_layout()] {
            check::<Lru>(&layout, local, &reads)?;
            check::<Fifo>(&layout, local, &reads)?;
            check::<Clock>(&layout, local, &reads)?;
            check::<Random>(&layout, local, &reads)?;
        }
    }

    #[test]
    fn a_memory_smaller_than_its_records_is_right_all_the_same(
        ways in 1u32..=3, sets in 1u32..=2, reads in prop::collection::vec((0..Section::COUNT, 0u32..400), 0..400),
    ) {
        // No topology allows so few lines; here the lines of a material drive each other out.
        for layout in [layout(), padded_layout()] {
            let (image, cluster_memory) = (image(&layout), cluster_memory(&layout));
            let database_lines = (layout.database_bytes() / 16) as u32;
            let geometry = Geometry { line_bytes: 16, database_lines, sets: u64::from(sets), ways: u64::from(ways) };
            let mut memory = LocalMemory::<Random, _>::new(geometry, &layout, 9, &cluster_memory);
            for &(section, index) in &reads {
                let section = Section::ALL[section];
                let index = index % RECORDS[section as usize] as u32;
                let start = layout.address(section, index).0 as usize;
                let record = read(&mut memory, section, index).expect("in range");
                prop_assert_eq!(&record, &image[start..start + section.content_bytes() as usize]);
            }
        }
    }
}

#[test]
fn a_record_with_two_missing_lines_is_one_fetch() {
    let cluster_memory = cluster_memory(&layout());
    let mut memory = counting::<Lru>(&cluster_memory, &layout(), local(MemorySize::Bytes(4096), 64, None));
    memory.set_ray_kind(RayKind::Shadow);
    // Triangle 1 is bytes 40 to 79 of its section, which starts on a line: lines 0 and 1.
    memory.triangle(1).expect("in range");
    memory.triangle(0).expect("in range");
    memory.triangle(0).expect("in range");
    let stats = memory.take_stats();
    let counted = stats.counters[RayKind::Shadow as usize][section_class(Section::Triangles)];
    assert_eq!(counted, Counters { record_accesses: 3, record_misses: 1, line_accesses: 4, line_misses: 2 });
    assert_eq!(stats.total(), counted);
    assert_eq!(stats.words_read(&layout()), 30);
    assert_eq!(memory.take_stats(), MemoryStats::default());
    // The accesses before a fetch are counted on, whatever was taken.
    memory.sphere(0).expect("in range");
    assert_eq!(memory.source_mut().accesses_before, 3);
}

#[test]
fn octree_nodes_are_counted_by_level() {
    let cluster_memory = cluster_memory(&layout());
    let mut memory = counting::<Lru>(&cluster_memory, &layout(), local(MemorySize::All, 64, None));
    for level in [0, 1, 1, 20, 21, u32::MAX] {
        memory.octree_node(0, level).expect("in range");
    }
    let counted = memory.take_stats().counters[RayKind::Primary as usize].map(|c| c.record_accesses);
    assert_eq!((counted[0], counted[1], counted[20]), (1, 2, 3));
    assert_eq!(counted.iter().sum::<u64>(), 6, "no level is counted as another section");
}

#[test]
fn a_record_out_of_range_is_an_error() {
    for layout in [layout(), padded_layout()] {
        let cluster_memory = cluster_memory(&layout);
        let mut memory = counting::<Lru>(&cluster_memory, &layout, local(MemorySize::All, 64, None));
        for section in Section::ALL {
            for index in [RECORDS[section as usize] as u32, u32::MAX] {
                assert_eq!(read(&mut memory, section, index), Err(MemoryError::OutOfRange { section, index }));
            }
        }
        assert_eq!(memory.take_stats().total(), Counters::default());
    }
}

/// A record of 496 bytes from the last word of a line of 16 on lies in 32 lines: all bits of a fetch's mask.
#[test]
fn the_largest_record_is_one_fetch() {
    let layout = padded_layout();
    let cluster_memory = cluster_memory(&layout);
    let mut memory = counting::<Lru>(&cluster_memory, &layout, local(MemorySize::All, 16, None));
    memory.polygon(0).expect("in range");
    let stats = memory.take_stats();
    let counted = stats.counters[RayKind::Primary as usize][section_class(Section::Polygons)];
    // Polygon 0 begins with its section, on a line.
    assert_eq!(counted, Counters { record_accesses: 1, record_misses: 1, line_accesses: 31, line_misses: 31 });
    assert_eq!((memory.source_mut().fetches, memory.source_mut().bytes, stats.words_read(&layout)), (1, 496, 124));
    let lines = (0..31u32).fold(Missing::<32>::new(Section::Polygons, 7), |mut missing, line| {
        missing.add(7 + line, line);
        missing
    });
    let mut all = lines;
    all.add(38, 31);
    assert_eq!((all.request(2, 0).lines, all.lines().count()), (u32::MAX, 32));
}

#[test]
fn after_a_failed_fetch_nothing_wrong_is_read() {
    let (image, cluster_memory) = (image(&layout()), cluster_memory(&layout()));
    let mut memory = counting::<Lru>(&cluster_memory, &layout(), local(MemorySize::All, 64, None));
    memory.source_mut().broken = true;
    assert_eq!(memory.triangle(1), Err(MemoryError::Source(None)));
    memory.source_mut().broken = false;
    let start = layout().span(Section::Triangles).base.0 as usize + 40;
    assert_eq!(read(&mut memory, Section::Triangles, 1).expect("mended"), image[start..start + 40]);
}

#[test]
fn cleared_it_fetches_again() {
    let cluster_memory = cluster_memory(&layout());
    let mut memory = counting::<Lru>(&cluster_memory, &layout(), local(MemorySize::All, 64, None));
    for _ in 0..2 {
        memory.sphere(0).expect("in range");
        memory.sphere(0).expect("in range");
        memory.clear();
    }
    assert_eq!(memory.source_mut().fetches, 2);
}
